// Zip archives of members that are stored as they are, each made part by part while it is written.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace farol {

// Appends the next part of a member; nothing at its end.
using NextPart = std::function<void(std::string&)>;

class ZipWriter {
 public:
  ZipWriter();
  ~ZipWriter();
  ZipWriter(const ZipWriter&) = delete;
  ZipWriter& operator=(const ZipWriter&) = delete;

  // A member that is `head` and what `more`, where it is given, makes: `size` bytes in all of that.
  void add(const std::string& name, std::string head, uint64_t size = 0, NextPart more = nullptr);

  // The file appears whole or not at all; throws Error naming it. Members lie at multiples of 64 bytes, so that they can be used
  // where they lie. The same members give the same bytes.
  void write(const std::string& path);

 private:
  struct Member;
  std::vector<std::unique_ptr<Member>> members_;
};

}  // namespace farol
