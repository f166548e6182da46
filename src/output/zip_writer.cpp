#include "output/zip_writer.h"

#include "base/error.h"
#include "base/output_file.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <zip.h>

namespace farol {
namespace {

// Where libzip writes. Whole blocks of 2 MiB at multiples of 2 MiB go to the file: systems whose file cache knows large pages keep
// each in one, and reading the file where it lies then costs a five-hundredth of the page faults.
class BlockedFile {
 public:
  explicit BlockedFile(std::ostream& to) : to_(to) {}

  uint64_t at() const { return start_ + pending_.size(); }
  bool append(const char* bytes, uint64_t count) {
    while (count > 0) {
      const uint64_t fits = std::min(count, kBlock - at() % kBlock);
      pending_.append(bytes, fits);
      bytes += fits;
      count -= fits;
      if (at() % kBlock == 0 && !flush()) return false;
    }
    return true;
  }
  bool flush() {
    to_.write(pending_.data(), static_cast<std::streamsize>(pending_.size()));
    start_ += pending_.size();
    end_ = std::max(end_, start_);
    pending_.clear();
    return to_.good();
  }
  bool seek(void* to, uint64_t length) {
    const zip_int64_t place = zip_source_seek_compute_offset(at(), std::max(end_, at()), to, length, &error);
    if (place < 0 || !flush()) return false;
    start_ = static_cast<uint64_t>(place);
    return to_.seekp(place).good();
  }

  zip_error_t error{};

 private:
  static constexpr uint64_t kBlock = uint64_t{1} << 21;

  std::ostream& to_;
  std::string pending_;
  uint64_t start_ = 0, end_ = 0;  // of what is pending, of what was written
};

zip_int64_t writeBlocks(void* state, void* data, zip_uint64_t length, zip_source_cmd_t command) {
  auto& file = *static_cast<BlockedFile*>(state);
  const auto done = [&](bool good, zip_int64_t result = 0) {
    if (!good && zip_error_code_zip(&file.error) == ZIP_ER_OK) zip_error_set(&file.error, ZIP_ER_WRITE, errno);
    return good ? result : -1;
  };
  switch (command) {
    case ZIP_SOURCE_SUPPORTS:
      return zip_source_make_command_bitmap(
          ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE, ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE, ZIP_SOURCE_SEEK,
          ZIP_SOURCE_TELL, ZIP_SOURCE_BEGIN_WRITE, ZIP_SOURCE_COMMIT_WRITE, ZIP_SOURCE_ROLLBACK_WRITE, ZIP_SOURCE_REMOVE,
          ZIP_SOURCE_SEEK_WRITE, ZIP_SOURCE_SUPPORTS, ZIP_SOURCE_TELL_WRITE, ZIP_SOURCE_WRITE, -1);
    case ZIP_SOURCE_STAT: {  // a new file
      auto* stat = static_cast<zip_stat_t*>(data);
      zip_stat_init(stat);
      stat->size = 0;
      stat->valid |= ZIP_STAT_SIZE;
      return sizeof(zip_stat_t);
    }
    case ZIP_SOURCE_WRITE:
      return done(file.append(static_cast<const char*>(data), length), static_cast<zip_int64_t>(length));
    case ZIP_SOURCE_SEEK_WRITE:
      return done(file.seek(data, length));
    case ZIP_SOURCE_TELL_WRITE:
      return static_cast<zip_int64_t>(file.at());
    case ZIP_SOURCE_COMMIT_WRITE:
      return done(file.flush());
    case ZIP_SOURCE_ERROR:
      return zip_error_to_data(&file.error, data, length);
    default:
      return 0;
  }
}

}  // namespace

struct ZipWriter::Member {
  std::string name, pending;
  uint64_t size = 0;  // [bytes]
  NextPart more;
  size_t taken = 0;
  zip_error_t error{};

  static zip_int64_t read(void* state, void* data, zip_uint64_t length, zip_source_cmd_t command) {
    auto& m = *static_cast<Member*>(state);
    switch (command) {
      case ZIP_SOURCE_SUPPORTS:
        return zip_source_make_command_bitmap(ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE, ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR,
                                              ZIP_SOURCE_FREE, -1);
      case ZIP_SOURCE_READ: {
        zip_uint64_t given = 0;
        while (given < length) {
          if (m.taken == m.pending.size()) {
            m.pending.clear();
            m.taken = 0;
            if (m.more) m.more(m.pending);
            if (m.pending.empty()) break;
          }
          const size_t count = std::min<size_t>(length - given, m.pending.size() - m.taken);
          std::memcpy(static_cast<char*>(data) + given, m.pending.data() + m.taken, count);
          m.taken += count;
          given += count;
        }
        return static_cast<zip_int64_t>(given);
      }
      case ZIP_SOURCE_STAT: {
        auto* stat = static_cast<zip_stat_t*>(data);
        zip_stat_init(stat);
        stat->mtime = 315532800;  // 1980: the same input gives the same bytes
        stat->valid |= ZIP_STAT_MTIME;
        return sizeof(zip_stat_t);
      }
      case ZIP_SOURCE_ERROR:
        return zip_error_to_data(&m.error, data, length);
      default:
        return 0;
    }
  }
};

ZipWriter::ZipWriter() = default;
ZipWriter::~ZipWriter() = default;

void ZipWriter::add(const std::string& name, std::string head, uint64_t size, NextPart more) {
  auto member = std::make_unique<Member>();
  member->name = name;
  member->size = head.size() + size;
  member->pending = std::move(head);
  member->more = std::move(more);
  members_.push_back(std::move(member));
}

void ZipWriter::write(const std::string& path) {
  OutputFile file(path);
  BlockedFile blocks(file.stream());
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* target = zip_source_function_create(writeBlocks, &blocks, &error);
  zip_t* archive = target != nullptr ? zip_open_from_source(target, ZIP_CREATE | ZIP_TRUNCATE, &error) : nullptr;
  const auto fail = [&](const char* what) {
    const std::string reason = archive != nullptr ? zip_strerror(archive) : zip_error_strerror(&error);
    if (archive != nullptr)
      zip_discard(archive);
    else if (target != nullptr)
      zip_source_free(target);
    zip_error_fini(&error);
    throw Error("cannot write {}: {} ({})", path, reason, what);
  };
  if (archive == nullptr) fail("opening");
  uint64_t end = 0;
  for (const auto& m : members_) {
    zip_source_t* source = zip_source_function(archive, Member::read, m.get());
    const zip_int64_t at = source != nullptr ? zip_file_add(archive, m->name.c_str(), source, 0) : -1;
    if (at < 0 || zip_set_file_compression(archive, static_cast<zip_uint64_t>(at), ZIP_CM_STORE, 0) != 0) fail(m->name.c_str());
    // Padded by an extra field as zipalign uses it. A local header has 30 bytes, its name, 20 bytes about sizes beyond 4 GiB, and
    // this.
    constexpr uint16_t kAlignment = 0xD935, kMultiple = 64, kFieldHead = 4;
    const uint64_t start = end + 30 + m->name.size() + 20 + kFieldHead;
    const std::string padding((kMultiple - start % kMultiple) % kMultiple, '\0');
    if (zip_file_extra_field_set(archive, static_cast<zip_uint64_t>(at), kAlignment, ZIP_EXTRA_FIELD_NEW,
                                 reinterpret_cast<const zip_uint8_t*>(padding.data()), static_cast<zip_uint16_t>(padding.size()),
                                 ZIP_FL_LOCAL) != 0)
      fail(m->name.c_str());
    end = start + padding.size() + m->size;
  }
  if (zip_close(archive) != 0) fail("writing");
  zip_error_fini(&error);
  file.commit();
}

}  // namespace farol
