#include "output/factor_archive.h"

#include "base/clones.h"
#include "base/error.h"
#include "output/mapped_zip.h"
#include "output/npy.h"
#include "output/zip_writer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <functional>
#include <numeric>
#include <tbb/parallel_for.h>

namespace farol {
namespace {

// Light can cross a mirror several times: entries towards mirrors and glass may exceed 1.
constexpr float kMostFactor = 1024;

// Both without a branch per entry: they look at all of F.
FAROL_CLONES bool ascending(std::span<const uint32_t> ids, size_t below) {
  uint32_t wrong = 0;
  for (size_t k = 1; k < ids.size(); ++k) wrong |= ids[k] <= ids[k - 1] ? 1 : 0;
  return wrong == 0 && (ids.empty() || ids.back() < below);
}
// From 0 to the most, which as bits are those of the smallest numbers: signs and what is no number are above.
FAROL_CLONES bool possible(std::span<const float> factors) {
  uint32_t most = 0;
  for (const float f : factors) most = std::max(most, std::bit_cast<uint32_t>(f));
  return most <= std::bit_cast<uint32_t>(kMostFactor);
}

template <typename T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <typename T>
std::string bytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

// Ascending ids of a row, of entries that are not 0 in some channel, with the values of one channel.
void compressed(const FormFactorMatrix& f, size_t i, int c, std::vector<int32_t>& ids, std::vector<float>& values) {
  ids.clear();
  values.clear();
  std::array<std::vector<float>, 3> all;
  const size_t channels = f.coloured() ? 3 : 1;
  for (size_t k = 0; k < channels; ++k) all[k] = f.ofChannel(static_cast<int>(k))[i].expanded();
  for (size_t j = 0; j < all[0].size(); ++j) {
    if (all[0][j] == 0 && (channels == 1 || (all[1][j] == 0 && all[2][j] == 0))) continue;
    ids.push_back(static_cast<int32_t>(j));
    values.push_back(all[static_cast<size_t>(c)][j]);
  }
}

// The members that hold values, one per channel where F is coloured.
std::vector<std::string> dataMembers(bool coloured) {
  return coloured ? std::vector<std::string>{"data_r", "data_g", "data_b"} : std::vector<std::string>{"data"};
}

}  // namespace

void writeFactorsNpz(const std::string& path, const FormFactorMatrix& f, const PatchSet& patches, const KeptFactors& about,
                     const std::vector<uint32_t>& again, const FormFactorMatrix* rows) {
  const size_t n = f.size();
  std::vector<double> area, exposed, correction;
  std::vector<std::array<double, 3>> missed, backs, cut, absorbed;
  std::vector<int32_t> ids;
  std::vector<float> values;
  for (size_t i = 0; i < n; ++i) {
    const RowShares& s = f.shares(i);
    area.push_back(patches.patches[i].area);
    for (const auto& [to, what] : {std::pair(&missed, &RowShares::missed), std::pair(&backs, &RowShares::backs),
                                   std::pair(&cut, &RowShares::cut), std::pair(&absorbed, &RowShares::absorbed)})
      to->push_back({s.*what, f.ofChannel(1).shares(i).*what, f.ofChannel(2).shares(i).*what});
    exposed.push_back(s.exposed);
    correction.push_back(s.correction);
  }
  ZipWriter archive;
  const auto add = [&](const std::string& name, const NpyHeader& header, const std::string& data) {
    archive.add(name + ".npy", npyHeader(header) + data);
  };
  const auto numbers = [&](const char* name, const std::vector<double>& v) { add(name, {"<f8", {v.size()}}, bytesOf(v)); };
  const auto text = [&](const char* name, const std::string& t) { add(name, {fmt::format("|S{}", t.size()), {}}, t); };
  // Some rows of a matrix in CSR form.
  const auto addRows = [&](const std::string& prefix, const FormFactorMatrix& from, const std::vector<uint32_t>& which) {
    std::vector<int64_t> starts{0};
    for (const uint32_t i : which) {
      compressed(from, i, 0, ids, values);
      starts.push_back(starts.back() + static_cast<int64_t>(ids.size()));
    }
    const auto entries = static_cast<uint64_t>(starts.back());
    // scipy.sparse.load_npz wants one type for both index members.
    const bool wide = entries > INT32_MAX;
    const char* index = wide ? "<i8" : "<i4";
    std::string startBytes;
    for (const int64_t s : starts) wide ? append(startBytes, s) : append(startBytes, static_cast<int32_t>(s));
    add(prefix + "indptr", {index, {starts.size()}}, startBytes);
    std::vector<std::string> arrays = dataMembers(from.coloured());
    arrays.insert(arrays.begin(), "indices");
    for (size_t a = 0; a < arrays.size(); ++a) {
      const bool isIndex = a == 0;
      const int c = isIndex ? 0 : static_cast<int>(a) - 1;
      const uint64_t size = entries * (isIndex && wide ? sizeof(int64_t) : sizeof(float));
      const auto rowByRow = [&, isIndex, c, wide, row = size_t{0}](std::string& bytes) mutable {
        for (; row < which.size() && bytes.empty(); ++row) {
          compressed(from, which[row], c, ids, values);
          if (!isIndex)
            bytes = bytesOf(values);
          else if (!wide)
            bytes = bytesOf(ids);
          else
            for (const int32_t id : ids) append(bytes, int64_t{id});
        }
      };
      archive.add(prefix + arrays[a] + ".npy", npyHeader({isIndex ? index : "<f4", {entries}}), size, rowByRow);
    }
  };
  text("farol_method", about.method);
  add("farol_seed", {"<u8", {}}, bytesOf(std::vector<uint64_t>{about.seed}));
  numbers("farol_patch_options", {static_cast<double>(about.patches.count), about.patches.size, about.patches.cluster});
  const Fingerprint& print = about.fingerprint;
  add("farol_hash", {"<u8", {3}}, bytesOf(std::vector<uint64_t>{print.geometry, print.patches, print.specular}));
  numbers("farol_area", area);
  for (const auto& [name, shares] : {std::pair("farol_missed", &missed), std::pair("farol_backs", &backs),
                                     std::pair("farol_cut", &cut), std::pair("farol_absorbed", &absorbed)}) {
    if (f.coloured()) {
      add(name, {"<f8", {n, 3}}, bytesOf(*shares));
    } else {
      std::vector<double> alike;
      for (const auto& s : *shares) alike.push_back(s[0]);
      numbers(name, alike);
    }
  }
  numbers("farol_exposed", exposed);
  numbers("farol_correction", correction);
  text("format", "csr");
  add("shape", {"<i8", {2}}, bytesOf(std::vector<uint64_t>{n, n}));
  std::vector<uint32_t> all(n);
  std::iota(all.begin(), all.end(), 0u);
  addRows("", f, all);
  if (rows != nullptr) {
    add("farol_again_patches", {"<u4", {again.size()}}, bytesOf(again));
    std::vector<double> seenNothing;
    for (const uint32_t i : again) {
      for (int c = 0; c < (f.coloured() ? 3 : 1); ++c) seenNothing.push_back(rows->ofChannel(c).shares(i).missed);
    }
    numbers("farol_again_missed", seenNothing);
    addRows("farol_again_", *rows, again);
  }
  archive.write(path);
}

// The archive and its members.
struct FactorArchive::Impl {
  explicit Impl(const std::string& p) : zip(p), path(zip.path()) {}

  // One member: its header, and its data where they lie.
  struct Array {
    NpyHeader header;
    std::string name;
    KeptBytes data;

    uint64_t count() const {
      return std::accumulate(header.shape.begin(), header.shape.end(), uint64_t{1}, [](uint64_t a, uint64_t b) { return a * b; });
    }
  };
  Array open(const std::string& name) const {
    Array array{{}, name + ".npy", zip.member(name + ".npy")};
    constexpr size_t kLeading = 10;
    const std::span<const std::byte> bytes = array.data.bytes;
    const auto* text = reinterpret_cast<const char*>(bytes.data());
    const int length = bytes.size() < kLeading ? -1 : npyDictionaryLength(text);
    const bool whole = length >= 0 && bytes.size() - kLeading >= static_cast<size_t>(length);
    if (!whole || !parseNpyDictionary(std::string(text + kLeading, static_cast<size_t>(length)), array.header))
      throw Error("{}: member {} is not a NumPy array in C order", path, array.name);
    array.data.bytes = bytes.subspan(kLeading + static_cast<size_t>(length));
    return array;
  }
  // So many values of a type, where they lie if that is a place for them.
  template <typename T>
  std::span<const T> valuesOf(Array& array, const char* descr, uint64_t count) const {
    if (array.header.descr != descr || array.count() != count) {
      throw Error("{}: member {} holds {} values of type {}, {} of type {} are wanted", path, array.name, array.count(),
                  array.header.descr, count, descr);
    }
    if (count == 0) return {};  // of no size as the archive tells it, or of one that does not matter
    if (array.data.bytes.size() / sizeof(T) < count) throw Error("{}: member {} is damaged or ends too soon", path, array.name);
    if (reinterpret_cast<uintptr_t>(array.data.bytes.data()) % alignof(T) != 0) {
      const auto copy = std::make_shared<std::vector<T>>(count);
      std::memcpy(copy->data(), array.data.bytes.data(), count * sizeof(T));
      array.data = {std::as_bytes(std::span(*copy)), copy};
    }
    return {reinterpret_cast<const T*>(array.data.bytes.data()), count};
  }
  template <typename T>
  std::vector<T> array(const std::string& name, const char* descr, uint64_t count) const {
    Array a = open(name);
    const std::span<const T> values = valuesOf<T>(a, descr, count);
    return {values.begin(), values.end()};
  }
  // At most so many values.
  template <typename T>
  std::vector<T> some(const std::string& name, const char* descr, uint64_t most) const {
    Array a = open(name);
    if (a.header.shape.size() != 1 || a.header.shape[0] > most)
      throw Error("{}: member {} does not hold at most {} values", path, a.name, most);
    const std::span<const T> values = valuesOf<T>(a, descr, a.header.shape[0]);
    return {values.begin(), values.end()};
  }
  std::string text(const std::string& name) const {
    const Array a = open(name);
    constexpr int kLongest = 1000;
    const int length = a.header.descr.starts_with("|S") ? std::atoi(a.header.descr.c_str() + 2) : 0;
    if (length < 1 || length > kLongest || !a.header.shape.empty() || a.data.bytes.size() < static_cast<size_t>(length))
      throw Error("{}: member {} is not a text", path, a.name);
    return {reinterpret_cast<const char*>(a.data.bytes.data()), static_cast<size_t>(length)};
  }

  MappedZip zip;
  const std::string& path;
  KeptFactors about;
};

FactorArchive::FactorArchive(const std::string& path) : impl_(std::make_unique<Impl>(path)) {
  KeptFactors& about = impl_->about;
  about.method = impl_->text("farol_method");
  about.seed = impl_->array<uint64_t>("farol_seed", "<u8", 1)[0];
  auto options = impl_->some<double>("farol_patch_options", "<f8", 3);
  const bool sensible = options.size() >= 2 && options[0] >= 1 && options[0] <= 1e10 && options[1] >= 0 && options[1] < 1e300 &&
                        (options.size() < 3 || (options[2] >= 0 && options[2] <= 60));
  if (!sensible) throw Error("{}: patch options are not possible: a count, a size, degrees of clusters", path);
  options.resize(3, 0.0);  // older files know of no clusters
  about.patches = {static_cast<size_t>(options[0]), options[1]};
  about.patches.cluster = options[2];
  const auto hash = impl_->array<uint64_t>("farol_hash", "<u8", 3);
  about.fingerprint = {hash[0], hash[1], hash[2]};
  if (impl_->text("format") != "csr") throw Error("{}: the matrix is not in CSR form", path);
}
FactorArchive::~FactorArchive() = default;

const KeptFactors& FactorArchive::about() const { return impl_->about; }

void FactorArchive::requireSame(const Fingerprint& scene, const std::string& scenePath) const {
  const Fingerprint& kept = impl_->about.fingerprint;
  const char* what = kept.geometry != scene.geometry   ? "the geometry differs"
                     : kept.patches != scene.patches   ? "the patches differ"
                     : kept.specular != scene.specular ? "mirrors or clear glass differ"
                                                       : nullptr;
  if (what != nullptr)
    throw Error("{}: these factors were not made for {}: {}; make them again with farol factors", impl_->path, scenePath, what);
}

FormFactorMatrix FactorArchive::load(size_t patches, uint64_t maxBytes) const {
  const Impl& a = *impl_;
  const auto shape = a.array<int64_t>("shape", "<i8", 2);
  if (shape[0] != static_cast<int64_t>(patches) || shape[1] != shape[0])
    throw Error("{}: holds {} x {} factors, the scene has {} patches", a.path, shape[0], shape[1], patches);
  const bool coloured = a.zip.has("data_r.npy");
  const size_t channels = coloured ? 3 : 1;
  const auto missed = a.array<double>("farol_missed", "<f8", channels * patches),
             backs = a.array<double>("farol_backs", "<f8", channels * patches),
             cut = a.array<double>("farol_cut", "<f8", channels * patches),
             absorbed = a.array<double>("farol_absorbed", "<f8", channels * patches),
             exposed = a.array<double>("farol_exposed", "<f8", patches),
             correction = a.array<double>("farol_correction", "<f8", patches);
  a.array<double>("farol_area", "<f8", patches);  // undamaged, that is all
  FormFactorMatrix f(patches, maxBytes);
  if (coloured) f.addChannels();
  std::vector<uint32_t> all(patches);
  std::iota(all.begin(), all.end(), 0u);
  for (int c = 0; c < static_cast<int>(channels); ++c) {
    const auto sharesOf = [&](size_t i) {
      const size_t at = channels * i + static_cast<size_t>(c);
      return RowShares{missed[at], backs[at], exposed[i], correction[i], cut[at], absorbed[at]};
    };
    loadRows(f, c, "", all, sharesOf);
  }
  return f;
}

std::optional<KeptReplicates> FactorArchive::replicates(size_t patches) const {
  const Impl& a = *impl_;
  if (!a.zip.has("farol_again_patches.npy")) return std::nullopt;
  KeptReplicates kept{a.some<uint32_t>("farol_again_patches", "<u4", patches), FormFactorMatrix(patches)};
  for (size_t k = 0; k < kept.patches.size(); ++k) {
    if (kept.patches[k] >= patches || (k > 0 && kept.patches[k] <= kept.patches[k - 1]))
      throw Error("{}: farol_again_patches are not ascending numbers of patches", a.path);
  }
  const size_t channels = a.zip.has("data_r.npy") ? 3 : 1;
  if (channels == 3) kept.rows.addChannels();
  const auto missed = a.array<double>("farol_again_missed", "<f8", channels * kept.patches.size());
  for (int c = 0; c < static_cast<int>(channels); ++c) {
    loadRows(kept.rows, c, "farol_again_", kept.patches, [&](size_t k) {
      RowShares shares;
      shares.missed = missed[channels * k + static_cast<size_t>(c)];
      return shares;
    });
  }
  return kept;
}

void FactorArchive::loadRows(FormFactorMatrix& to, int c, const std::string& prefix, const std::vector<uint32_t>& rows,
                             const std::function<RowShares(size_t)>& sharesOf) const {
  const Impl& a = *impl_;
  FormFactorMatrix& f = to.ofChannel(c);
  const size_t patches = f.size();
  Impl::Array indices = a.open(prefix + "indices"), data = a.open(prefix + dataMembers(to.coloured())[static_cast<size_t>(c)]);
  const bool wide = indices.header.descr == "<i8";
  std::vector<int64_t> starts;
  if (wide) {
    starts = a.array<int64_t>(prefix + "indptr", "<i8", rows.size() + 1);
  } else {
    const auto narrow = a.array<int32_t>(prefix + "indptr", "<i4", rows.size() + 1);
    starts.assign(narrow.begin(), narrow.end());
  }
  const auto entries = static_cast<uint64_t>(starts.back());
  const bool fits = starts[0] == 0 && std::is_sorted(starts.begin(), starts.end()) &&
                    indices.header.shape == std::vector<uint64_t>{entries} && data.header.shape == indices.header.shape &&
                    data.header.descr == "<f4" && (wide || indices.header.descr == "<i4");
  if (!fits) throw Error("{}: {}indptr, indices and data do not make a CSR matrix of float32", a.path, prefix);

  for (size_t k = 0; k < rows.size(); ++k) {
    const int64_t count = starts[k + 1] - starts[k];
    if (count > static_cast<int64_t>(patches))
      throw Error("{}: row {} has {} entries of at most {}", a.path, rows[k], count, patches);
  }

  // Rows that stay lists stay where they lie in the file.
  std::span<const uint32_t> ids;
  if (wide) {
    const auto wideIds = a.valuesOf<int64_t>(indices, "<i8", entries);
    const auto narrow = std::make_shared<std::vector<uint32_t>>(entries);
    std::transform(wideIds.begin(), wideIds.end(), narrow->begin(),
                   [](int64_t j) { return static_cast<uint32_t>(std::clamp<int64_t>(j, 0, INT32_MAX)); });
    indices.data.owner = narrow;
    ids = *narrow;
  } else {
    ids = a.valuesOf<uint32_t>(indices, "<i4", entries);
  }
  const auto values = a.valuesOf<float>(data, "<f4", entries);
  const auto owner = std::make_shared<const std::pair<KeptBytes, KeptBytes>>(indices.data, data.data);
  tbb::parallel_for(size_t{0}, rows.size(), [&](size_t k) {
    const auto at = static_cast<size_t>(starts[k]), length = static_cast<size_t>(starts[k + 1] - starts[k]);
    const auto rowIds = ids.subspan(at, length);
    const auto rowValues = values.subspan(at, length);
    if (!ascending(rowIds, patches) || !possible(rowValues))
      throw Error("{}: row {} has an entry outside the matrix or outside [0, {}]", a.path, rows[k], kMostFactor);
    if (f.worthAList(length))
      f.borrow(rows[k], rowIds, rowValues, owner);
    else
      f.entries(rows[k], rowIds, rowValues);
    f.finish(rows[k], sharesOf(k));
  });
}

}  // namespace farol
