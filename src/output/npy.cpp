#include "output/npy.h"

#include <cstdlib>
#include <cstring>
#include <fmt/format.h>

namespace farol {

std::string npyHeader(const NpyHeader& header) {
  std::string shape;
  for (const uint64_t n : header.shape) shape += fmt::format("{}, ", n);
  if (header.shape.size() > 1) shape.resize(shape.size() - 2);
  std::string text = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", header.descr,
                                 header.shape.size() == 1 ? shape.substr(0, shape.size() - 1) : shape);
  text.append((64 - (10 + text.size() + 1) % 64) % 64, ' ');
  text += '\n';
  std::string leading("\x93NUMPY\x01\0", 8);
  leading += static_cast<char>(text.size() % 256);
  leading += static_cast<char>(text.size() / 256);
  return leading + text;
}

int npyDictionaryLength(const char* leading) {
  if (std::memcmp(leading, "\x93NUMPY\x01", 7) != 0) return -1;
  return static_cast<unsigned char>(leading[8]) + 256 * static_cast<unsigned char>(leading[9]);
}

bool parseNpyDictionary(const std::string& text, NpyHeader& header) {
  const auto after = [&](const char* key) {
    const size_t at = text.find(key);
    return at == std::string::npos ? at : at + std::strlen(key);
  };
  const size_t descr = after("'descr': '"), order = after("'fortran_order': "), shape = after("'shape': (");
  if (descr == std::string::npos || order == std::string::npos || shape == std::string::npos) return false;
  if (text.compare(order, 5, "False") != 0) return false;
  const size_t end = text.find('\'', descr), close = text.find(')', shape);
  if (end == std::string::npos || close == std::string::npos) return false;
  header.descr = text.substr(descr, end - descr);
  header.shape.clear();
  for (const char *at = text.c_str() + shape, *last = text.c_str() + close; at < last;) {
    char* next = nullptr;
    const unsigned long long n = std::strtoull(at, &next, 10);
    if (next == at) return false;
    header.shape.push_back(n);
    at = next;
    while (at < last && (*at == ',' || *at == ' ')) ++at;
  }
  return true;
}

}  // namespace farol
