#include "solve/gather.h"

#include "base/clones.h"

#include <cstring>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace farol {
namespace {

// Eight partial sums per row and channel, always in the same order: neither the number of rows nor, where multiply and
// add are fused, the instruction set changes a bit.
constexpr size_t kLanes = 8;
using Partial = double[3][kLanes];

// Adds what j below `last`, a multiple of eight, bring.
template <typename Factor>
using Gather = void (*)(const Factor* const* rows, const double* b, size_t n, size_t last, Partial* sums);

template <typename Factor, size_t Rows>
void gatherPlain(const Factor* const* rows, const double* b, size_t n, size_t last, Partial* sums) {
  for (size_t j = 0; j < last; j += kLanes) {
    for (size_t r = 0; r < Rows; ++r) {
      for (size_t k = 0; k < kLanes; ++k) {
        const auto f = static_cast<double>(rows[r][j + k]);
        for (size_t c = 0; c < 3; ++c) sums[r][c][k] += f * b[c * n + j + k];
      }
    }
  }
}

#if defined(__x86_64__)
[[gnu::target("avx2,fma"), gnu::always_inline]] inline __m256d fourOf(const float* from) {
  return _mm256_cvtps_pd(_mm_loadu_ps(from));
}
[[gnu::target("avx2,fma"), gnu::always_inline]] inline __m256d fourOf(const uint16_t* from) {
  return _mm256_cvtepi32_pd(_mm_cvtepu16_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(from))));
}
[[gnu::target("avx512f"), gnu::always_inline]] inline __m512d eightOf(const float* from) {
  return __builtin_convertvector(_mm256_loadu_ps(from), __m512d);
}
[[gnu::target("avx512f"), gnu::always_inline]] inline __m512d eightOf(const uint16_t* from) {
  using Integers [[gnu::vector_size(32)]] = int;
  using Shorts [[gnu::vector_size(16)]] = uint16_t;
  Shorts shorts;
  std::memcpy(&shorts, from, sizeof shorts);
  return __builtin_convertvector(__builtin_convertvector(shorts, Integers), __m512d);
}

template <typename Factor, size_t Rows>
[[gnu::target("avx2,fma")]] void gatherAvx2(const Factor* const* rows, const double* b, size_t n, size_t last,
                                            Partial* sums) {
  if constexpr (Rows > 2) {  // sixteen registers hold the sums of two rows
    gatherAvx2<Factor, 2>(rows, b, n, last, sums);
    gatherAvx2<Factor, Rows - 2>(rows + 2, b, n, last, sums + 2);
  } else {
    __m256d part[Rows][3][2];
    std::memcpy(part, sums, sizeof part);
    for (size_t j = 0; j < last; j += kLanes) {
      for (size_t r = 0; r < Rows; ++r) {
        for (size_t h = 0; h < 2; ++h) {
          const __m256d f = fourOf(rows[r] + j + 4 * h);
          for (size_t c = 0; c < 3; ++c)
            part[r][c][h] = _mm256_fmadd_pd(f, _mm256_loadu_pd(b + c * n + j + 4 * h), part[r][c][h]);
        }
      }
    }
    std::memcpy(sums, part, sizeof part);
  }
}

template <typename Factor, size_t Rows>
[[gnu::target("avx512f")]] void gatherAvx512(const Factor* const* rows, const double* b, size_t n, size_t last,
                                              Partial* sums) {
  __m512d part[Rows][3];
  std::memcpy(part, sums, sizeof part);
  for (size_t j = 0; j < last; j += kLanes) {
    const __m512d from[3] = {_mm512_loadu_pd(b + j), _mm512_loadu_pd(b + n + j), _mm512_loadu_pd(b + 2 * n + j)};
    for (size_t r = 0; r < Rows; ++r) {
      const __m512d f = eightOf(rows[r] + j);
      for (size_t c = 0; c < 3; ++c) part[r][c] = _mm512_fmadd_pd(f, from[c], part[r][c]);
    }
  }
  std::memcpy(sums, part, sizeof part);
}
#endif

// For the processor that runs this.
template <typename Factor, size_t Rows>
Gather<Factor> chosenGather() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f")) return gatherAvx512<Factor, Rows>;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return gatherAvx2<Factor, Rows>;
#endif
  return gatherPlain<Factor, Rows>;
}

template <typename Factor>
void gatherDense(std::span<const Factor* const> rows, const double* b, size_t n, double (*sums)[3]) {
  constexpr size_t kGroup = 8;
  static const Gather<Factor> one = chosenGather<Factor, 1>(), group = chosenGather<Factor, kGroup>();
  alignas(64) Partial partial[kRowsAtOnce] = {};
  const size_t even = n / kLanes * kLanes;
  size_t done = 0;
  for (; done + kGroup <= rows.size(); done += kGroup) group(rows.data() + done, b, n, even, partial + done);
  for (; done < rows.size(); ++done) one(rows.data() + done, b, n, even, partial + done);
  for (size_t r = 0; r < rows.size(); ++r) {
    for (size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (const double p : partial[r][c]) sum += p;
      for (size_t j = even; j < n; ++j) sum += static_cast<double>(rows[r][j]) * b[c * n + j];
      sums[r][c] = sum;
    }
  }
}

}  // namespace

void gatherRows(std::span<const float* const> rows, const double* b, size_t n, double (*sums)[3]) {
  gatherDense(rows, b, n, sums);
}
void gatherRows(std::span<const uint16_t* const> rows, const double* b, size_t n, double (*sums)[3]) {
  gatherDense(rows, b, n, sums);
}

#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
FAROL_CLONES
#endif
void gatherHits(std::span<const uint32_t> ids, double weight, const double* packed, double* sums) {
  constexpr size_t kSide = 4;  // hits side by side, to hide the additions' latency
  double partial[kSide][4] = {};
  size_t k = 0;
  for (; k + kSide <= ids.size(); k += kSide) {
    for (size_t l = 0; l < kSide; ++l) {
      const double* from = packed + size_t{4} * ids[k + l];
      for (size_t c = 0; c < 4; ++c) partial[l][c] += from[c];
    }
  }
  for (; k < ids.size(); ++k) {
    for (size_t c = 0; c < 4; ++c) partial[0][c] += packed[size_t{4} * ids[k] + c];
  }
  for (size_t c = 0; c < 3; ++c)
    sums[c] = weight * ((partial[0][c] + partial[1][c]) + (partial[2][c] + partial[3][c]));
}

void gatherEntries(std::span<const uint32_t> ids, std::span<const float> values, const double* packed, double* sums) {
  constexpr size_t kSide = 2;
  double partial[kSide][4] = {};
  size_t k = 0;
  for (; k + kSide <= ids.size(); k += kSide) {
    for (size_t l = 0; l < kSide; ++l) {
      const double* from = packed + size_t{4} * ids[k + l];
      for (size_t c = 0; c < 4; ++c) partial[l][c] += static_cast<double>(values[k + l]) * from[c];
    }
  }
  for (; k < ids.size(); ++k) {
    for (size_t c = 0; c < 4; ++c) partial[0][c] += static_cast<double>(values[k]) * packed[size_t{4} * ids[k] + c];
  }
  for (size_t c = 0; c < 3; ++c) sums[c] = partial[0][c] + partial[1][c];
}

}  // namespace farol
