// The header of NumPy's format 1.0 (numpy.lib.format): magic, version, length, a Python dictionary padded to a multiple
// of 64 bytes. Data follow it in C order.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace farol {

struct NpyHeader {
  std::string descr;            // "<f4", "<i8", "|S3"
  std::vector<uint64_t> shape;  // empty: one value
};
std::string npyHeader(const NpyHeader& header);

// Of the text between the 10 leading bytes and the data. False when it is not understood or not in C order.
bool parseNpyDictionary(const std::string& text, NpyHeader& header);

// The 10 leading bytes: the length of the dictionary after them, or -1 where they are not of this format.
int npyDictionaryLength(const char* leading);

}  // namespace farol
