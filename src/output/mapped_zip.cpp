#include "output/mapped_zip.h"

#include "base/error.h"
#include "base/machine.h"

#include <algorithm>
#include <cstring>
#include <libdeflate.h>
#include <tbb/parallel_for.h>
#include <vector>
#include <zip.h>
#include <zlib.h>

namespace farol {
namespace {

// The file as libzip reads it. Where it read last tells where a member's bytes lie, which its interface does not.
struct View {
  std::span<const std::byte> bytes;
  zip_uint64_t at = 0, last = 0;
  zip_error_t error{};
};

zip_int64_t readView(void* state, void* data, zip_uint64_t length, zip_source_cmd_t command) {
  auto& view = *static_cast<View*>(state);
  switch (command) {
    case ZIP_SOURCE_SUPPORTS:
      return zip_source_make_command_bitmap(ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE, ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR,
                                            ZIP_SOURCE_FREE, ZIP_SOURCE_SEEK, ZIP_SOURCE_TELL, ZIP_SOURCE_SUPPORTS, -1);
    case ZIP_SOURCE_OPEN:
      view.at = 0;
      return 0;
    case ZIP_SOURCE_READ: {
      const zip_uint64_t count = std::min<zip_uint64_t>(length, view.bytes.size() - view.at);
      std::memcpy(data, view.bytes.data() + view.at, count);
      view.last = view.at;
      view.at += count;
      return static_cast<zip_int64_t>(count);
    }
    case ZIP_SOURCE_STAT: {
      auto* stat = static_cast<zip_stat_t*>(data);
      zip_stat_init(stat);
      stat->size = view.bytes.size();
      stat->valid |= ZIP_STAT_SIZE;
      return sizeof(zip_stat_t);
    }
    case ZIP_SOURCE_SEEK: {
      const zip_int64_t to = zip_source_seek_compute_offset(view.at, view.bytes.size(), data, length, &view.error);
      if (to < 0) return -1;
      view.at = static_cast<zip_uint64_t>(to);
      return 0;
    }
    case ZIP_SOURCE_TELL:
      return static_cast<zip_int64_t>(view.at);
    case ZIP_SOURCE_ERROR:
      return zip_error_to_data(&view.error, data, length);
    default:
      return 0;
  }
}

// libdeflate knows the instructions for it, zlib how to put parts together.
uint32_t checksumOf(std::span<const std::byte> bytes) {
  constexpr size_t kPart = size_t{1} << 22;
  std::vector<uLong> parts((bytes.size() + kPart - 1) / kPart);
  const auto part = [&](size_t k) { return bytes.subspan(k * kPart, std::min(kPart, bytes.size() - k * kPart)); };
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t k) { parts[k] = libdeflate_crc32(0, part(k).data(), part(k).size()); });
  uLong sum = 0;
  for (size_t k = 0; k < parts.size(); ++k) sum = crc32_combine(sum, parts[k], static_cast<z_off_t>(part(k).size()));
  return static_cast<uint32_t>(sum);
}

}  // namespace

struct MappedZip::Impl {
  explicit Impl(const std::string& p) : path(p), file(mapFile(p)) {
    view.bytes = {file.bytes.get(), file.size};
    zip_error_t error;
    zip_error_init(&error);
    zip_source_t* source = zip_source_function_create(readView, &view, &error);
    if (source != nullptr) archive = zip_open_from_source(source, ZIP_RDONLY | ZIP_CHECKCONS, &error);
    const std::string reason = zip_error_strerror(&error);
    if (archive == nullptr && source != nullptr) zip_source_free(source);
    zip_error_fini(&error);
    if (archive == nullptr) throw Error("{}: the file of factors cannot be read: {}", path, reason);
  }
  ~Impl() { zip_discard(archive); }

  std::string path;
  MappedFile file;
  View view;
  zip_t* archive = nullptr;
};

MappedZip::MappedZip(const std::string& path) : impl_(std::make_unique<Impl>(path)) {}
MappedZip::~MappedZip() = default;

const std::string& MappedZip::path() const { return impl_->path; }

bool MappedZip::has(const std::string& member) const { return zip_name_locate(impl_->archive, member.c_str(), 0) >= 0; }

KeptBytes MappedZip::member(const std::string& name) const {
  Impl& a = *impl_;
  zip_stat_t stat;
  if (zip_stat(a.archive, name.c_str(), 0, &stat) != 0) throw Error("{}: not a file of factors: it has no member {}", a.path, name);
  constexpr zip_uint64_t kWanted = ZIP_STAT_INDEX | ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_CRC | ZIP_STAT_COMP_METHOD;
  if ((stat.valid & kWanted) != kWanted || stat.comp_method != ZIP_CM_STORE || stat.size != stat.comp_size)
    throw Error("{}: member {} is compressed; form factors are read from members that are not", a.path, name);
  if (stat.size == 0) return {};
  char first = 0;
  zip_file_t* file = zip_fopen_index(a.archive, stat.index, 0);
  const bool opened = file != nullptr && zip_fread(file, &first, 1) == 1;
  if (file != nullptr) zip_fclose(file);
  const zip_uint64_t start = a.view.last, end = start + stat.size;
  const bool inside = opened && end >= start && end <= a.view.bytes.size();
  if (!inside) throw Error("{}: member {} is damaged or ends too soon", a.path, name);
  const auto bytes = a.view.bytes.subspan(start, stat.size);
  if (checksumOf(bytes) != stat.crc) throw Error("{}: member {} is damaged", a.path, name);
  return {bytes, a.file.bytes};
}

}  // namespace farol
