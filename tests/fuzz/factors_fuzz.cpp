// Any bytes as a file of kept factors: read, or refused with a sentence. Checksums would keep all damage out: every input is
// read a second time with its checksums made right.
#include "base/error.h"
#include "fuzz_file.h"
#include "output/factor_archive.h"

#include <cmath>
#include <cstring>
#include <vector>
#include <zlib.h>

using namespace farol;

namespace {

template <typename T>
T read(const std::vector<uint8_t>& bytes, size_t at) {
  T value;
  std::memcpy(&value, &bytes[at], sizeof value);
  return value;
}

// PKWARE's APPNOTE: a central record holds the checksum at 16, the stored size at 20, the name's and the extra field's
// length at 28 and 30, the local header's place at 42; a local header its checksum at 14, those lengths at 26 and 28, and
// is 30 bytes long. What needs zip64 is larger than any input.
void repairChecksums(std::vector<uint8_t>& bytes) {
  constexpr size_t kCentral = 46, kLocal = 30;
  for (size_t at = 0; at + kCentral <= bytes.size(); ++at) {
    if (std::memcmp(&bytes[at], "PK\1\2", 4) != 0) continue;
    const size_t size = read<uint32_t>(bytes, at + 20), local = read<uint32_t>(bytes, at + 42);
    if (local + kLocal > bytes.size()) continue;
    const size_t start = local + kLocal + read<uint16_t>(bytes, local + 26) + read<uint16_t>(bytes, local + 28);
    if (start > bytes.size() || size > bytes.size() - start) continue;
    const auto sum = static_cast<uint32_t>(crc32(0, bytes.data() + start, static_cast<uInt>(size)));
    std::memcpy(&bytes[at + 16], &sum, 4);
    std::memcpy(&bytes[local + 14], &sum, 4);
  }
}

void readFactors(const std::string& path) {
  try {
    const FactorArchive archive(path);
    constexpr uint64_t kMemory = 64u << 20;
    // The number of patches is the scene's: it never comes from the file.
    const FormFactorMatrix f = archive.load(8, kMemory);
    double sum = 0;
    for (size_t i = 0; i < f.size(); ++i) sum += f.rowSum(i);
    if (const auto again = archive.replicates(8)) {
      for (const uint32_t i : again->patches) sum += again->rows.rowSum(i);
    }
    if (!std::isfinite(sum)) __builtin_trap();
  } catch (const Error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const fuzz::FileInMemory file("F.npz");
  std::vector<uint8_t> bytes(data, data + size);
  file.write(bytes);
  readFactors(file.path());
  repairChecksums(bytes);
  file.write(bytes);
  readFactors(file.path());
  return 0;
}
