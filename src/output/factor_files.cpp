#include "base/error.h"
#include "base/output_file.h"
#include "output/output.h"

#include <cstdio>
#include <fmt/ostream.h>
#include <fstream>
#include <numeric>

namespace farol {

void writeFactorsNpy(const std::string& path, const FormFactorMatrix& f) {
  OutputFile file(path);
  // NumPy format 1.0: magic, version, header length, a Python dictionary padded to a multiple of 64 bytes.
  std::string header =
      fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}), }}", f.size(), f.size());
  header.append((64 - (10 + header.size() + 1) % 64) % 64, ' ');
  header += '\n';
  file.stream() << "\x93NUMPY" << '\x01' << '\0' << static_cast<char>(header.size() % 256)
                << static_cast<char>(header.size() / 256) << header;
  for (size_t i = 0; i < f.size(); ++i) {
    const std::vector<float> row = f[i].expanded();
    file.stream().write(reinterpret_cast<const char*>(row.data()),
                        static_cast<std::streamsize>(row.size() * sizeof(float)));
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
  if (!file || std::string(start, 6) != "\x93NUMPY" || start[6] != 1)
    throw Error("{}: not a NumPy file of version 1", path);
  std::string header(static_cast<unsigned char>(start[8]) + 256u * static_cast<unsigned char>(start[9]), ' ');
  file.read(header.data(), static_cast<std::streamsize>(header.size()));
  unsigned long rows = 0, columns = 0;
  const size_t shape = header.find("'shape': (");
  const bool known = header.find("'<f4'") != std::string::npos && header.find("'fortran_order': False") != std::string::npos;
  if (!file || !known || shape == std::string::npos ||
      std::sscanf(header.c_str() + shape, "'shape': (%lu, %lu)", &rows, &columns) != 2)
    throw Error("{}: not a matrix of little-endian float32 in rows", path);
  if (rows != patches || columns != patches) {
    throw Error("{}: holds {} x {} factors, the scene has {} patches with these options", path, rows, columns, patches);
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
