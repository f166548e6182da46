#include "base/error.h"
#include "base/output_file.h"
#include "output/npy.h"
#include "output/output.h"

#include <fmt/ostream.h>
#include <fstream>
#include <numeric>

namespace farol {

void writeFactorsNpy(const std::string& path, const FormFactorMatrix& f) {
  OutputFile file(path);
  file.stream() << npyHeader({"<f4", {f.size(), f.size()}});
  for (size_t i = 0; i < f.size(); ++i) {
    const std::vector<float> row = f[i].expanded();
    file.stream().write(reinterpret_cast<const char*>(row.data()), static_cast<std::streamsize>(row.size() * sizeof(float)));
  }
  file.commit();
}

void writeFactorsMtx(const std::string& path, const FormFactorMatrix& f) {
  size_t entries = 0;
  for (size_t i = 0; i < f.size(); ++i) {
    for (const float v : f[i].expanded()) entries += v > 0 ? 1 : 0;
  }
  OutputFile file(path);
  fmt::print(file.stream(),
             "%%MatrixMarket matrix coordinate real general\n% F(i,j): share of the power leaving patch i that reaches "
             "patch j\n{} {} {}\n",
             f.size(), f.size(), entries);
  for (size_t i = 0; i < f.size(); ++i) {
    const std::vector<float> row = f[i].expanded();
    for (size_t j = 0; j < row.size(); ++j) {
      if (row[j] > 0) fmt::print(file.stream(), "{} {} {}\n", i + 1, j + 1, row[j]);
    }
  }
  file.commit();
}

FormFactorMatrix loadFactorsNpy(const std::string& path, size_t patches) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error("{}: the file of factors cannot be read", path);
  char start[10] = {};
  file.read(start, sizeof start);
  const int length = file ? npyDictionaryLength(start) : -1;
  if (length < 0) throw Error("{}: not a NumPy file of version 1", path);
  std::string dictionary(static_cast<size_t>(length), ' ');
  file.read(dictionary.data(), length);
  NpyHeader header;
  if (!file || !parseNpyDictionary(dictionary, header) || header.descr != "<f4" || header.shape.size() != 2)
    throw Error("{}: not a matrix of little-endian float32 in rows", path);
  if (header.shape[0] != patches || header.shape[1] != patches) {
    throw Error("{}: holds {} x {} factors, the scene has {} patches with these options", path, header.shape[0], header.shape[1],
                patches);
  }
  FormFactorMatrix f(patches);
  for (uint32_t i = 0; i < patches; ++i) {
    const std::span<float> row = f.row(i);
    file.read(reinterpret_cast<char*>(row.data()), static_cast<std::streamsize>(row.size_bytes()));
    if (!file) throw Error("{}: ends in row {} of {}", path, i, patches);
    for (const float v : row) {
      if (!(v >= 0 && v <= 1)) throw Error("{}: row {} holds {}, outside [0, 1]", path, i, v);
    }
    const double sum = std::accumulate(row.begin(), row.end(), 0.0);
    f.finish(i, {std::max(0.0, 1 - sum), 0, sum > 0 ? 1.0 : 0.0});
  }
  return f;
}

}  // namespace farol
