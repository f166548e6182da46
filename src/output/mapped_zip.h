// A zip archive whose members are used where they lie in the file: nothing is read before it is asked for, and nothing copied.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

namespace farol {

// Some bytes and what keeps them.
struct KeptBytes {
  std::span<const std::byte> bytes;
  std::shared_ptr<const void> owner;
};

// Who changes the file in place meanwhile changes what is seen; whole new files under the same name, as farol writes them, do not.
class MappedZip {
 public:
  explicit MappedZip(const std::string& path);  // throws Error where the file is no sound archive
  ~MappedZip();
  MappedZip(const MappedZip&) = delete;
  MappedZip& operator=(const MappedZip&) = delete;

  const std::string& path() const;
  bool has(const std::string& member) const;
  // A member that was stored as it is, its checksum compared on all cores. Throws Error naming file and member.
  KeptBytes member(const std::string& name) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace farol
