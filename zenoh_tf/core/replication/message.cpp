#include "replication/message.hpp"

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <optional>
#include <unordered_set>

#include "base/rejected.hpp"
#include "commits/validation.hpp"
#include "messages/cursor.hpp"
#include "messages/writer.hpp"

namespace ztf {

namespace {

static_assert(std::endian::native == std::endian::little);
static_assert(sizeof(ChangeKind) == 1 && sizeof(Pose) == 7 * sizeof(double));

constexpr std::size_t kMostTexts = 1 << 20;  // as MAX_LIST in zenoh_tf/wire/fields.py

[[noreturn]] void reject(const char* field, const std::string& why, Code code) {
  throw Rejected{.code = code, .message = why, .field = field};
}

[[noreturn]] void reject_malformed(const char* field, const std::string& expected) {
  reject(field, "field " + quoted(field) + " must be " + expected, Code::protocol);
}

[[noreturn]] void reject_invalid(const char* field, const std::string& why) {
  reject(field, std::string(field) + " " + why, Code::invalid_argument);
}

template <class Columns>
std::string pack_columns(const Columns& columns) {
  std::size_t fields = 2, bytes = 256;
  Columns::each_column([&](const char*, auto of_columns) {
    fields += 2;
    bytes += (columns.*of_columns).size_bytes();
  });
  MessageWriter out(bytes);
  out.map(fields);
  const auto add_texts = [&](const char* field, std::span<const std::string_view> texts) {
    out.text(field).list(texts.size());
    for (const std::string_view text : texts) out.text(text);
  };
  add_texts("names", columns.names);
  add_texts("authorities", columns.authorities);
  Columns::each_column([&](const char* field, auto of_columns) {
    const auto column = std::as_bytes(columns.*of_columns);
    out.column(field, {reinterpret_cast<const char*>(column.data()), column.size()});
  });
  return out.take();
}

// Fields that follow those of the columns are ignored.
template <class Columns>
Received<Columns> parse_columns(std::string_view message, const char* what) {
  MessageCursor cursor(message);
  MessageHead map;
  if (!cursor.head(map) || map.kind != MessageHead::Kind::map)
    reject_malformed(what, "the map of its columns");
  Received<Columns> received;
  const auto find = [&](const char* field) {
    std::string_view key, padding;
    const auto next = [&] { return map.size-- != 0 && cursor.text(key); };
    if (!next() || (key.empty() && !(cursor.binary(padding) && next())) || key != field)
      reject_malformed(field, "in its place in " + quoted(what));
  };
  find("names");
  if (!cursor.names(kMostTexts, received.names)) reject_malformed("names", "a list of texts");
  find("authorities");
  if (!cursor.names(kMostTexts, received.authorities))
    reject_malformed("authorities", "a list of texts");
  received.columns.names = received.names;
  received.columns.authorities = received.authorities;
  Columns::each_column([&]<class T, class Of>(const char* field,
                                              std::span<const T> Of::* of_columns) {
    std::string_view bytes;
    find(field);
    if (!cursor.binary(bytes)) reject_malformed(field, "binary");
    if (bytes.size() % sizeof(T) != 0)
      reject_malformed(field, "a multiple of " + std::to_string(sizeof(T)) + " bytes, not " +
                                  std::to_string(bytes.size()));
    if (bytes.empty()) return;
    const char* values = bytes.data();
    if (reinterpret_cast<std::uintptr_t>(values) % alignof(T) != 0) {
      auto& copy = received.values.emplace_back(new std::byte[bytes.size()]);
      std::memcpy(copy.get(), values, bytes.size());
      values = reinterpret_cast<const char*>(copy.get());
    }
    received.columns.*of_columns = {reinterpret_cast<const T*>(values), bytes.size() / sizeof(T)};
  });
  if (map.size == 0 && !cursor.at_end()) reject_malformed(what, "a map and nothing else");
  return received;
}

template <class T>
void check_rows(const char* field, std::span<const T> column, std::size_t rows) {
  if (column.size() != rows)
    reject_malformed(field, std::to_string(rows) + " rows, not " + std::to_string(column.size()));
}

// The same of a column of indexes into texts. `none`: an index that refers to none of them.
void check_indexes(const char* field, std::span<const std::uint32_t> column, std::size_t rows,
                   std::span<const std::string_view> texts,
                   std::optional<std::uint32_t> none = {}) {
  check_rows(field, column, rows);
  const std::size_t size = texts.size();
  for (const std::uint32_t index : column)
    if (index >= size && index != none)
      reject_malformed(field, "indexes below " + std::to_string(size) +
                                  (none ? ", or " + std::to_string(*none) : "") + ", not " +
                                  std::to_string(index));
}

template <class Columns>
void check_columns(const Columns& columns, const Options& options) {
  // A frame under two indexes would be locked twice, by a thread that waits for itself.
  std::unordered_set<std::string_view> known(columns.names.size());
  for (const std::string_view name : columns.names) {
    if (name.empty()) reject_invalid("names", "has an empty name");
    if (name[0] == '/')
      reject_invalid("names", "has " + quoted(name) + ", but no frame's name begins with '/'");
    if (has_zero(name)) reject_invalid("names", "has a name with a zero character");
    if (name.size() > options.max_name_bytes)
      throw long_name_rejection(name.size(), "names", options);
    if (!known.insert(name).second) reject_invalid("names", "has a name twice");
  }
  for (const std::string_view name : columns.authorities)
    if (name.size() > options.max_name_bytes)
      throw long_name_rejection(name.size(), "authorities", options);
  // A version that is not one would leave a frame locked, or without a name.
  constexpr Version kBits = SeqLock::kWriting | SeqLock::kWriteLocked;
  for (const Version version : columns.version)
    if (version == 0 || (version & kBits) != 0)
      reject_invalid("version", "has " + std::to_string(version) + ", which no frame can have");
  // A pose that no commit accepts would make results infinite, or no number.
  for (const Pose& p : columns.pose) {
    const double norm2 = p.qx * p.qx + p.qy * p.qy + p.qz * p.qz + p.qw * p.qw;
    if (!is_valid_translation(p) || !(std::abs(norm2 - 1) < 1e-2))
      reject_invalid("pose", "has a value that no link can have");
  }
}

}  // namespace

std::string pack(const ChangeColumns& changes) { return pack_columns(changes); }
std::string pack(const FrameColumns& frames) { return pack_columns(frames); }

Received<ChangeColumns> parse_changes(std::string_view message) {
  auto received = parse_columns<ChangeColumns>(message, "changes");
  const ChangeColumns& t = received.columns;
  std::size_t samples = 0, orphaned = 0;
  for (const ChangeKind kind : t.kind) {
    if (kind > ChangeKind::orphaned) reject_malformed("kind", "at most 6");
    samples += has_sample(kind);
    orphaned += kind == ChangeKind::orphaned;
  }
  check_indexes("frame", t.frame, t.kind.size(), t.names);
  check_rows("version", t.version, t.kind.size());
  check_indexes("parent", t.parent, samples, t.names, kNoParent);
  check_indexes("authority", t.authority, samples, t.authorities);
  check_rows("stamp", t.stamp, samples);
  check_rows("pose", t.pose, samples);
  check_indexes("lost", t.lost, orphaned, t.names, kNoParent);
  return received;
}

Received<FrameColumns> parse_frames(std::string_view message) {
  auto received = parse_columns<FrameColumns>(message, "frames");
  const FrameColumns& t = received.columns;
  const std::size_t n = t.frame.size();
  check_indexes("frame", t.frame, n, t.names);
  check_rows("version", t.version, n);
  check_rows("static", t.is_static, n);
  check_indexes("authority", t.authority, n, t.authorities);
  check_rows("count", t.count, n);
  const std::size_t samples = std::accumulate(t.count.begin(), t.count.end(), std::size_t{0});
  check_rows("stamp", t.stamp, samples);
  check_indexes("parent", t.parent, samples, t.names, kNoParent);
  check_rows("pose", t.pose, samples);
  return received;
}

void check_replayable(const ChangeColumns& changes, const Options& options) {
  check_columns(changes, options);
}

void check_replayable(const FrameColumns& frames, const Options& options) {
  check_columns(frames, options);
  const Stamp* stamp = frames.stamp.data();
  for (std::size_t i = 0; i < frames.frame.size(); stamp += frames.count[i++]) {
    if (frames.is_static[i] && frames.count[i] != 1)
      reject_invalid("count", "must be 1 of a frame with a static link");
    for (std::uint32_t k = 1; k < frames.count[i]; ++k)
      if (stamp[k] <= stamp[k - 1]) reject_invalid("stamp", "must ascend in each frame");
  }
}

}  // namespace ztf
