#include "solve/gather.h"

#include <algorithm>
#include <cstring>
#include <type_traits>

namespace farol {
namespace {

// Loops are written once, in vectors that the compiler maps to what each processor has, and compiled for three of them.
// Partial sums are added in one order: neither the number of rows nor, where multiply and add are fused, the instruction
// set changes a bit.
constexpr size_t kLanes = 8;
template <typename Number, size_t Count>
using Vector [[gnu::vector_size(Count * sizeof(Number))]] = Number;
using Lanes = Vector<double, kLanes>;

template <typename From>
[[gnu::always_inline]] inline void load(const From* from, Lanes& to) {
  Vector<From, kLanes> values;
  std::memcpy(&values, from, sizeof values);
  if constexpr (std::is_same_v<From, uint16_t>)  // by way of int, for which there are instructions
    to = __builtin_convertvector(__builtin_convertvector(values, Vector<int32_t, kLanes>), Lanes);
  else
    to = __builtin_convertvector(values, Lanes);
}

// Adds what j below `last`, a multiple of the lanes, bring. Eight rows at once are more than processors fetch ahead by themselves.
template <size_t Channels, typename Factor, size_t Rows>
[[gnu::always_inline]] inline void denseLoop(const Factor* const* rows, const double* b, size_t n, size_t last, Lanes (*sums)[Channels]) {
  constexpr size_t kAhead = 128, kPerLine = 64 / sizeof(Factor);
  Lanes part[Rows][Channels];
  std::memcpy(part, sums, sizeof part);
  for (size_t j = 0; j < last; j += kLanes) {
    Lanes from[Channels], f;
    for (size_t c = 0; c < Channels; ++c) load(b + c * n + j, from[c]);
    for (size_t r = 0; r < Rows; ++r) {
      load(rows[r] + j, f);
      if (j % kPerLine == 0) __builtin_prefetch(rows[r] + j + kAhead);
      for (size_t c = 0; c < Channels; ++c) part[r][c] += f * from[c];
    }
  }
  std::memcpy(sums, part, sizeof part);
}

// Four entries of a list side by side, to hide the latency of additions, and a cache line of each row in turn: rows of
// neighbours come by the same patches at about the same time. What follows in memory is mostly the next row, so it is asked
// for ahead.
template <size_t Channels, bool Weighted, size_t Rows>
[[gnu::always_inline]] inline void listLoop(const ListRow* rows, const double* b, double (*sums)[Channels]) {
  constexpr size_t kStride = Channels == 3 ? 4 : 1, kSide = 4, kAhead = 256 / Rows, kPerLine = 16;
  using Values = std::conditional_t<kStride == 1, double, Vector<double, 4>>;
  Values part[Rows][kSide] = {};
  const auto add = [&](size_t r, size_t k, size_t l) __attribute__((always_inline)) {
    Values from;
    std::memcpy(&from, b + kStride * rows[r].ids[k + l], sizeof from);
    if constexpr (Weighted)
      part[r][l % kSide] += static_cast<double>(rows[r].values[k + l]) * from;
    else
      part[r][l % kSide] += from;
  };
  const auto addLine = [&](size_t r, size_t k) __attribute__((always_inline)) {
    __builtin_prefetch(rows[r].ids + k + kAhead);
    if constexpr (Weighted) __builtin_prefetch(rows[r].values + k + kAhead);
#pragma GCC unroll 16
    for (size_t l = 0; l < kPerLine; ++l) add(r, k, l);
  };
  size_t together = rows[0].count;
  for (size_t r = 1; r < Rows; ++r) together = std::min(together, rows[r].count);
  together -= together % kPerLine;
  for (size_t k = 0; k < together; k += kPerLine) {
#pragma GCC unroll 4
    for (size_t r = 0; r < Rows; ++r) addLine(r, k);
  }
#pragma GCC unroll 4
  for (size_t r = 0; r < Rows; ++r) {
    size_t k = together;
    for (; k + kPerLine <= rows[r].count; k += kPerLine) addLine(r, k);
    for (size_t l = 0; l < rows[r].count - k; ++l) add(r, k, l);
    const Values sum = (part[r][0] + part[r][1]) + (part[r][2] + part[r][3]);
    std::memcpy(sums[r], &sum, sizeof sums[r]);
  }
}

// The loops for one kind of processor, whose registers hold the sums of GROUP rows. NOLINTBEGIN(bugprone-macro-parentheses)
#define FAROL_LOOPS_FOR(NAME, GROUP, TARGET)                                                                               \
  struct NAME {                                                                                                            \
    template <size_t Channels, typename Factor, size_t Rows>                                                               \
    TARGET static void dense(const Factor* const* rows, const double* b, size_t n, size_t last, Lanes (*sums)[Channels]) { \
      if constexpr (Rows > (GROUP)) {                                                                                      \
        dense<Channels, Factor, GROUP>(rows, b, n, last, sums);                                                            \
        dense<Channels, Factor, Rows - (GROUP)>(rows + (GROUP), b, n, last, sums + (GROUP));                               \
      } else {                                                                                                             \
        denseLoop<Channels, Factor, Rows>(rows, b, n, last, sums);                                                         \
      }                                                                                                                    \
    }                                                                                                                      \
    template <size_t Channels, bool Weighted, size_t Rows>                                                                 \
    TARGET static void list(const ListRow* rows, const double* b, double (*sums)[Channels]) {                              \
      listLoop<Channels, Weighted, Rows>(rows, b, sums);                                                                   \
    }                                                                                                                      \
  };
// NOLINTEND(bugprone-macro-parentheses)
FAROL_LOOPS_FOR(Plain, 1, )
#if defined(__x86_64__)
FAROL_LOOPS_FOR(Avx2, 2, [[gnu::target("avx2,fma")]])
FAROL_LOOPS_FOR(Avx512, 8, [[gnu::target("avx512f,avx512vl,fma")]])
#endif
#undef FAROL_LOOPS_FOR

// `choose(X{})` for the best X that this processor has.
template <typename Choose>
auto chosen(Choose choose) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")) return choose(Avx512{});
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return choose(Avx2{});
#endif
  return choose(Plain{});
}

}  // namespace

template <size_t Channels, typename Factor>
void gatherRows(std::span<const Factor* const> rows, const double* b, size_t n, double (*sums)[Channels]) {
  constexpr size_t kGroup = 8;
  static const auto one = chosen([](auto processor) { return &decltype(processor)::template dense<Channels, Factor, 1>; });
  static const auto group = chosen([](auto processor) { return &decltype(processor)::template dense<Channels, Factor, kGroup>; });
  Lanes partial[kRowsAtOnce][Channels] = {};
  const size_t even = n / kLanes * kLanes;
  size_t done = 0;
  for (; done + kGroup <= rows.size(); done += kGroup) group(rows.data() + done, b, n, even, partial + done);
  for (; done < rows.size(); ++done) one(rows.data() + done, b, n, even, partial + done);
  for (size_t r = 0; r < rows.size(); ++r) {
    for (size_t c = 0; c < Channels; ++c) {
      double sum = 0;
      for (size_t k = 0; k < kLanes; ++k) sum += partial[r][c][k];
      for (size_t j = even; j < n; ++j) sum += static_cast<double>(rows[r][j]) * b[c * n + j];
      sums[r][c] = sum;
    }
  }
}

template <size_t Channels, bool Weighted>
void gatherLists(std::span<const ListRow> rows, const double* b, double (*sums)[Channels]) {
  constexpr size_t kGroup = 4;
  static const auto one = chosen([](auto processor) { return &decltype(processor)::template list<Channels, Weighted, 1>; });
  static const auto group = chosen([](auto processor) { return &decltype(processor)::template list<Channels, Weighted, kGroup>; });
  size_t done = 0;
  for (; done + kGroup <= rows.size(); done += kGroup) group(rows.data() + done, b, sums + done);
  for (; done < rows.size(); ++done) one(rows.data() + done, b, sums + done);
}

template void gatherRows(std::span<const float* const>, const double*, size_t, double (*)[3]);
template void gatherRows(std::span<const float* const>, const double*, size_t, double (*)[1]);
template void gatherRows(std::span<const uint16_t* const>, const double*, size_t, double (*)[3]);
template void gatherRows(std::span<const uint16_t* const>, const double*, size_t, double (*)[1]);
template void gatherLists<3, true>(std::span<const ListRow>, const double*, double (*)[3]);
template void gatherLists<1, true>(std::span<const ListRow>, const double*, double (*)[1]);
template void gatherLists<3, false>(std::span<const ListRow>, const double*, double (*)[3]);
template void gatherLists<1, false>(std::span<const ListRow>, const double*, double (*)[1]);

}  // namespace farol
