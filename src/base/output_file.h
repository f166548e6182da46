// Output that appears whole or not at all: written under a temporary name beside the target, then renamed.
#pragma once

#include <fstream>
#include <string>

namespace farol {

// Throws when `path` cannot become a file (its folder is missing or read-only, or it names a folder),
// so that hours of work are not lost to a typing error.
void requireWritable(const std::string& path);

class OutputFile {
 public:
  explicit OutputFile(const std::string& path);
  ~OutputFile();  // removes the temporary file unless committed
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  std::ostream& stream() { return stream_; }
  const std::string& temporaryPath() const { return writing_; }  // for libraries that open files themselves
  void closeStream() { stream_.close(); }                        // before such a library writes
  void commit();                                                 // flush, then rename; throws when the disk is full

 private:
  std::string path_, writing_;
  std::ofstream stream_;
  bool direct_ = false;  // the target is a device such as /dev/stdout: written as it is
  bool committed_ = false;
};

}  // namespace farol
