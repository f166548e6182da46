#include "solve/gather.h"

#include <algorithm>
#include <bit>
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

template <typename From, typename Number>
[[gnu::always_inline]] inline void load(const From* from, Vector<Number, kLanes>& to) {
  Vector<From, kLanes> values;
  std::memcpy(&values, from, sizeof values);
  if constexpr (std::is_same_v<From, uint16_t>)  // by way of int, for which there are instructions
    to = __builtin_convertvector(__builtin_convertvector(values, Vector<int32_t, kLanes>), Vector<Number, kLanes>);
  else
    to = __builtin_convertvector(values, Vector<Number, kLanes>);
}

// Adds what j below `last`, a multiple of the lanes, bring. Eight rows at once are more than processors fetch ahead by themselves.
template <size_t Channels, typename Factor, typename Number, size_t Rows>
[[gnu::always_inline]] inline void denseLoop(const Factor* const* rows, const Number* b, size_t n, size_t last,
                                             Lanes (*sums)[Channels]) {
  constexpr size_t kAhead = 128, kPerLine = 64 / sizeof(Factor), kTogether = 128 * kLanes;
  for (size_t j = 0; j < last;) {
    Vector<Number, kLanes> part[Rows][Channels] = {};
    const size_t end = std::min(last, j + kTogether);
    for (; j < end; j += kLanes) {
      Vector<Number, kLanes> from[Channels], f;
      for (size_t c = 0; c < Channels; ++c) load<Number, Number>(b + c * n + j, from[c]);
      for (size_t r = 0; r < Rows; ++r) {
        load<Factor, Number>(rows[r] + j, f);
        if (j % kPerLine == 0) __builtin_prefetch(rows[r] + j + kAhead);
        for (size_t c = 0; c < Channels; ++c) part[r][c] += f * from[c];
      }
    }
    for (size_t r = 0; r < Rows; ++r) {
      for (size_t c = 0; c < Channels; ++c) sums[r][c] += __builtin_convertvector(part[r][c], Lanes);
    }
  }
}

// Lists follow each other in memory: what comes is asked for ahead, mostly of the next row.
template <bool Weighted>
[[gnu::always_inline]] inline void askAhead(const ListRow& row, size_t k) {
  constexpr size_t kAhead = 512;
  __builtin_prefetch(row.ids + k + kAhead);
  if constexpr (Weighted) __builtin_prefetch(row.values + k + kAhead);
}

constexpr size_t kListTogether = 64, kListLine = 16;  // entries added up before they go to a sum in double; in a line of memory

// Four entries of a list side by side, to hide the latency of additions.
template <bool Weighted, typename Number>
[[gnu::always_inline]] inline void listLoop(const ListRow& row, const Number* b, double (&sums)[1]) {
  constexpr size_t kSide = 4;
  sums[0] = 0;
  for (size_t k = 0; k < row.count;) {
    Number part[kSide] = {};
    const auto add = [&](size_t l) __attribute__((always_inline)) {
      const Number from = b[row.ids[k + l]];
      if constexpr (Weighted)
        part[l % kSide] += static_cast<Number>(row.values[k + l]) * from;
      else
        part[l % kSide] += from;
    };
    const size_t last = std::min(row.count, k + kListTogether);
    for (; k + kListLine <= last; k += kListLine) {
      askAhead<Weighted>(row, k);
#pragma GCC unroll 16
      for (size_t l = 0; l < kListLine; ++l) add(l);
    }
    for (size_t l = 0; l < last - k; ++l) add(l);
    k = last;
    sums[0] += static_cast<double>((part[0] + part[1]) + (part[2] + part[3]));
  }
}

// Loads are what processors run out of here: ids and values are read eight at once, entries are added in pairs.
template <bool Weighted, typename Number>
[[gnu::always_inline]] inline void listLoop(const ListRow& row, const Number* b, double (&sums)[3]) {
  static_assert(std::endian::native == std::endian::little);
  using Four = Vector<Number, 4>;
  using Pair = Vector<Number, 2 * 4>;
  constexpr size_t kPairs = 4, kTogether = 2 * kPairs;
  Vector<double, 4> sum{};
  for (size_t k = 0; k < row.count;) {
    Pair part[kPairs] = {};
    const auto addTogether = [&](size_t at) __attribute__((always_inline)) {
      uint64_t ids[kPairs];
      std::memcpy(ids, row.ids + at, sizeof ids);
      Pair values;
      if constexpr (Weighted) load<float, Number>(row.values + at, values);
      const auto add = [&]<int L>(std::integral_constant<int, L>) __attribute__((always_inline)) {
        Four first, second;
        std::memcpy(&first, b + size_t{4} * static_cast<uint32_t>(ids[L]), sizeof first);
        std::memcpy(&second, b + size_t{4} * (ids[L] >> 32), sizeof second);
        const Pair from = __builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7);
        if constexpr (Weighted)
          part[L] +=
              __builtin_shufflevector(values, values, 2 * L, 2 * L, 2 * L, 2 * L, 2 * L + 1, 2 * L + 1, 2 * L + 1, 2 * L + 1) *
              from;
        else
          part[L] += from;
      };
      add(std::integral_constant<int, 0>{});
      add(std::integral_constant<int, 1>{});
      add(std::integral_constant<int, 2>{});
      add(std::integral_constant<int, 3>{});
    };
    Four rest{};
    const size_t last = std::min(row.count, k + kListTogether);
    for (; k + kListLine <= last; k += kListLine) {
      askAhead<Weighted>(row, k);
      addTogether(k);
      addTogether(k + kTogether);
    }
    for (; k < last; ++k) {
      Four from;
      std::memcpy(&from, b + size_t{4} * row.ids[k], sizeof from);
      if constexpr (Weighted)
        rest += static_cast<Number>(row.values[k]) * from;
      else
        rest += from;
    }
    const Pair all = (part[0] + part[1]) + (part[2] + part[3]);
    rest += __builtin_shufflevector(all, all, 0, 1, 2, 3) + __builtin_shufflevector(all, all, 4, 5, 6, 7);
    sum += __builtin_convertvector(rest, decltype(sum));
  }
  std::memcpy(sums, &sum, sizeof sums);
}

// The loops for one kind of processor, whose registers hold the sums of GROUP rows in double.
// NOLINTBEGIN(bugprone-macro-parentheses)
#define FAROL_LOOPS_FOR(NAME, GROUP, TARGET)                                                                               \
  struct NAME {                                                                                                            \
    template <size_t Channels, typename Factor, typename Number, size_t Rows>                                              \
    TARGET static void dense(const Factor* const* rows, const Number* b, size_t n, size_t last, Lanes (*sums)[Channels]) { \
      constexpr size_t kGroup = (GROUP) * sizeof(double) / sizeof(Number);                                                 \
      if constexpr (Rows > kGroup) {                                                                                       \
        dense<Channels, Factor, Number, kGroup>(rows, b, n, last, sums);                                                   \
        dense<Channels, Factor, Number, Rows - kGroup>(rows + kGroup, b, n, last, sums + kGroup);                          \
      } else {                                                                                                             \
        denseLoop<Channels, Factor, Number, Rows>(rows, b, n, last, sums);                                                 \
      }                                                                                                                    \
    }                                                                                                                      \
    template <size_t Channels, bool Weighted, typename Number>                                                             \
    TARGET static void list(const ListRow& row, const Number* b, double (&sums)[Channels]) {                               \
      listLoop<Weighted, Number>(row, b, sums);                                                                            \
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

// As many rows as make whole groups of `Rows`; returns how many.
template <size_t Rows, size_t Channels, typename Factor, typename Number>
size_t gatherGroups(std::span<const Factor* const> rows, const Number* b, size_t n, size_t last, Lanes (*sums)[Channels]) {
  static const auto group =
      chosen([](auto processor) { return &decltype(processor)::template dense<Channels, Factor, Number, Rows>; });
  size_t done = 0;
  for (; done + Rows <= rows.size(); done += Rows) group(rows.data() + done, b, n, last, sums + done);
  return done;
}

}  // namespace

template <size_t Channels, typename Factor, typename Number>
void gatherRows(std::span<const Factor* const> rows, const Number* b, size_t n, double (*sums)[Channels]) {
  Lanes partial[kRowsAtOnce][Channels] = {};
  const size_t even = n / kLanes * kLanes;
  size_t done = gatherGroups<8>(rows, b, n, even, partial);
  done += gatherGroups<2>(rows.subspan(done), b, n, even, partial + done);
  gatherGroups<1>(rows.subspan(done), b, n, even, partial + done);
  for (size_t r = 0; r < rows.size(); ++r) {
    for (size_t c = 0; c < Channels; ++c) {
      double sum = 0;
      for (size_t k = 0; k < kLanes; ++k) sum += partial[r][c][k];
      for (size_t j = even; j < n; ++j) sum += static_cast<double>(rows[r][j]) * static_cast<double>(b[c * n + j]);
      sums[r][c] = sum;
    }
  }
}

template <size_t Channels, bool Weighted, typename Number>
void gatherLists(std::span<const ListRow> rows, const Number* b, double (*sums)[Channels]) {
  static const auto one = chosen([](auto processor) { return &decltype(processor)::template list<Channels, Weighted, Number>; });
  for (size_t r = 0; r < rows.size(); ++r) one(rows[r], b, sums[r]);
}

#define FAROL_GATHER(NUMBER)                                                                       \
  template void gatherRows(std::span<const float* const>, const NUMBER*, size_t, double(*)[3]);    \
  template void gatherRows(std::span<const float* const>, const NUMBER*, size_t, double(*)[1]);    \
  template void gatherRows(std::span<const uint16_t* const>, const NUMBER*, size_t, double(*)[3]); \
  template void gatherRows(std::span<const uint16_t* const>, const NUMBER*, size_t, double(*)[1]); \
  template void gatherLists<3, true>(std::span<const ListRow>, const NUMBER*, double(*)[3]);       \
  template void gatherLists<1, true>(std::span<const ListRow>, const NUMBER*, double(*)[1]);       \
  template void gatherLists<3, false>(std::span<const ListRow>, const NUMBER*, double(*)[3]);      \
  template void gatherLists<1, false>(std::span<const ListRow>, const NUMBER*, double(*)[1]);
FAROL_GATHER(double)
FAROL_GATHER(float)
#undef FAROL_GATHER

}  // namespace farol
