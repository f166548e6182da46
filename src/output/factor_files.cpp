#include "base/output_file.h"
#include "output/output.h"

#include <fmt/ostream.h>

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
  const std::vector<float> empty(f.size(), 0.0f);
  for (size_t i = 0; i < f.size(); ++i) {
    const std::span<const float> row = f[i].empty() ? std::span<const float>(empty) : f[i];
    file.stream().write(reinterpret_cast<const char*>(row.data()), static_cast<std::streamsize>(row.size_bytes()));
  }
  file.commit();
}

void writeFactorsMtx(const std::string& path, const FormFactorMatrix& f) {
  size_t entries = 0;
  for (size_t i = 0; i < f.size(); ++i) {
    for (const float v : f[i]) entries += v > 0 ? 1 : 0;
  }
  OutputFile file(path);
  fmt::print(file.stream(),
             "%%MatrixMarket matrix coordinate real general\n% F(i,j): share of the power leaving patch i that reaches "
             "patch j\n{} {} {}\n",
             f.size(), f.size(), entries);
  for (size_t i = 0; i < f.size(); ++i) {
    const auto row = f[i];
    for (size_t j = 0; j < row.size(); ++j) {
      if (row[j] > 0) fmt::print(file.stream(), "{} {} {}\n", i + 1, j + 1, row[j]);
    }
  }
  file.commit();
}

}  // namespace farol
