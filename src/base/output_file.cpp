#include "base/output_file.h"

#include "base/error.h"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <unistd.h>

namespace farol {
namespace fs = std::filesystem;

namespace {

bool isDevice(const std::string& path) {
  std::error_code ignored;
  const fs::file_status status = fs::status(path, ignored);
  return fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status);
}

}  // namespace

void requireWritable(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) throw Error("cannot write {}: it is a folder", path);
  if (isDevice(path)) return;
  fs::path folder = fs::path(path).parent_path();
  if (folder.empty()) folder = ".";
  if (!fs::is_directory(folder, ignored)) throw Error("cannot write {}: there is no folder {}", path, folder.string());
  if (access(folder.c_str(), W_OK) != 0) throw Error("cannot write {}: folder {} is read-only", path, folder.string());
}

OutputFile::OutputFile(const std::string& path) : path_(path) {
  requireWritable(path);
  direct_ = isDevice(path);
  writing_ = direct_ ? path : fmt::format("{}.{}.tmp", path, getpid());
  stream_.open(writing_, std::ios::binary | std::ios::trunc);
  if (!stream_) throw Error("cannot write {}: {}", path, std::strerror(errno));
}

OutputFile::~OutputFile() {
  if (committed_ || direct_) return;
  stream_.close();
  std::error_code ignored;
  fs::remove(writing_, ignored);
}

void OutputFile::commit() {
  if (stream_.is_open()) {
    stream_.flush();
    const bool good = stream_.good();
    stream_.close();
    if (!good || stream_.fail()) throw Error("cannot write {}: {}", path_, std::strerror(errno != 0 ? errno : EIO));
  }
  if (!direct_) {
    std::error_code error;
    fs::rename(writing_, path_, error);
    if (error) throw Error("cannot write {}: {}", path_, error.message());
  }
  committed_ = true;
}

}  // namespace farol
