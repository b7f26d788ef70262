// decode_puts: the messages of many puts as TransformRows;
// Tree._commit_puts: commits many TransformRows, each as a transaction of its own.
//
// A message is decoded here if it has the fields of a put and no others, in any order. The general
// decoder (zenoh_tf/wire/commit.py) takes all others, and says what is wrong with them.
//
// The scan reads untrusted bytes: every length is checked against what is left of the message
// before it is used, and memory is reserved only within the limits of rows and names.
//
// GIL: released once for all messages, and once for all commits. What is read meanwhile belongs to
// bytes and TransformRows, which nobody changes.
#include <nanobind/stl/optional.h>

#include <bit>
#include <new>

#include "bindings/commits/transform_rows.hpp"

namespace ztf {

namespace {

constexpr std::size_t kNamesPerRow = 3;     // as Limits.check_names of the server
constexpr std::size_t kDecodedName = 64;    // at most what Python needs beside a name's text
constexpr std::size_t kDecodedRest = 1024;  // the same of the map, its keys and columns

struct PutLimits {
  std::size_t rows, decoded_bytes;
};

bool is_utf8(std::string_view text) noexcept {
  const auto* at = reinterpret_cast<const unsigned char*>(text.data());
  const auto* const end = at + text.size();
  while (at != end) {
    const unsigned char head = *at++;
    if (head < 0x80) continue;
    if (head < 0xc2 || head > 0xf4) return false;
    // The second byte excludes overlong forms, surrogates and what is above U+10FFFF.
    unsigned char least = head == 0xe0 ? 0xa0 : head == 0xf0 ? 0x90 : 0x80;
    unsigned char most = head == 0xed ? 0x9f : head == 0xf4 ? 0x8f : 0xbf;
    for (int more = head < 0xe0 ? 1 : head < 0xf0 ? 2 : 3; more != 0; --more) {
      if (at == end || *at < least || *at > most) return false;
      ++at;
      least = 0x80;
      most = 0xbf;
    }
  }
  return true;
}

// The fields of a put. A function returns false if the message is of another form.
class PutScan {
 public:
  PutScan(std::string_view message, const PutLimits& limits) : rest_(message), limits_(limits) {}

  bool run() {
    const std::size_t size = rest_.size();
    constexpr std::string_view kSixFields = "\x86";
    if (!rest_.starts_with(kSixFields)) return false;
    rest_.remove_prefix(1);
    for (std::size_t i = 0; i < kFields; ++i)
      if (!field()) return false;
    if (!rest_.empty() || found_ != (1u << kFields) - 1) return false;
    if (kDecodedRest + size + names.size() * kDecodedName > limits_.decoded_bytes) return false;
    if (columns_.stamp.size() / sizeof(Stamp) > limits_.rows) return false;
    auto decoded = rows_of(columns_, names.size());
    if (!decoded) return false;
    rows = std::move(*decoded);
    return true;
  }

  std::vector<std::string_view> names;
  std::vector<Row> rows;

 private:
  static constexpr std::size_t kFields = 6;

  bool field() {
    std::string_view key;
    if (!text(key)) return false;
    if (key == "v") return first(0) && version();
    if (key == "names") return first(1) && name_list();
    if (key == "parent") return first(2) && binary(columns_.parent);
    if (key == "child") return first(3) && binary(columns_.child);
    if (key == "stamp") return first(4) && binary(columns_.stamp);
    return key == "pose" && first(5) && binary(columns_.pose);
  }
  // False for a field that was there before.
  bool first(unsigned field) {
    const unsigned bit = 1u << field;
    if (found_ & bit) return false;
    found_ |= bit;
    return true;
  }
  bool version() {
    if (!rest_.starts_with('\x01')) return false;
    rest_.remove_prefix(1);
    return true;
  }
  bool name_list() {
    unsigned char head = 0;
    std::size_t count = 0;
    if (!byte(head)) return false;
    if (head >= 0x90 && head < 0xa0)
      count = head & 0x0f;
    else if ((head != 0xdc && head != 0xdd) || !number(head == 0xdc ? 2 : 4, count))
      return false;
    if (count > rest_.size() || count > kNamesPerRow * limits_.rows) return false;
    names.resize(count);
    for (std::string_view& name : names)
      if (!text(name) || !is_utf8(name)) return false;
    return true;
  }
  bool text(std::string_view& out) {
    unsigned char head = 0;
    std::size_t size = 0;
    if (!byte(head)) return false;
    if (head >= 0xa0 && head < 0xc0)
      size = head & 0x1f;
    else if (head < 0xd9 || head > 0xdb || !number(std::size_t{1} << (head - 0xd9), size))
      return false;
    return take(size, out);
  }
  bool binary(std::string_view& out) {
    unsigned char head = 0;
    std::size_t size = 0;
    return byte(head) && head >= 0xc4 && head <= 0xc6 &&
           number(std::size_t{1} << (head - 0xc4), size) && take(size, out);
  }
  bool take(std::size_t size, std::string_view& out) {
    if (rest_.size() < size) return false;
    out = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return true;
  }
  bool byte(unsigned char& out) {
    if (rest_.empty()) return false;
    out = static_cast<unsigned char>(rest_[0]);
    rest_.remove_prefix(1);
    return true;
  }
  bool number(std::size_t bytes, std::size_t& out) {
    std::string_view digits;
    if (!take(bytes, digits)) return false;
    out = 0;
    for (const char digit : digits) out = out << 8 | static_cast<unsigned char>(digit);
    return true;
  }

  std::string_view rest_;
  const PutLimits& limits_;
  MessageColumns columns_;
  unsigned found_ = 0;  // a bit for each field
};

// TransformRows of each message, or None: it is of another form, or beyond a limit.
nb::list decode_puts(const nb::list& messages, std::size_t max_rows, std::size_t max_bytes) {
  struct Message {
    std::string_view data;
    std::vector<std::string_view> names;
    std::vector<Row> rows;
    bool is_decoded = false;
  };
  const PutLimits limits{max_rows, max_bytes};
  const nb::tuple kept = tuple_of(messages);
  std::vector<Message> decoded(kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i)
    if (PyBytes_CheckExact(kept[i].ptr())) {
      const nb::bytes data = nb::borrow<nb::bytes>(kept[i]);
      decoded[i].data = {data.c_str(), data.size()};
    }
  {
    const GilReleased released;
    for (Message& message : decoded) {
      PutScan scan(message.data, limits);
      try {
        message.is_decoded = scan.run();
      } catch (const std::bad_alloc&) {  // the general decoder reports it
      }
      if (!message.is_decoded) continue;
      message.names = std::move(scan.names);
      message.rows = std::move(scan.rows);
    }
  }
  nb::list rows;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    Message& message = decoded[i];
    if (message.is_decoded)
      rows.append(TransformRows(nb::borrow<nb::object>(kept[i]), std::move(message.names),
                                std::move(message.rows)));
    else
      rows.append(nb::none());
  }
  return rows;
}

// A put on its way into the tree.
struct PutCommit {
  CommitRequest request;
  std::span<std::uint8_t> stored;
  std::optional<Rejected> rejected;
  bool out_of_memory = false;
};

// Commits without the GIL. A put that is refused as a whole changes nothing, so the others are
// committed.
void commit_each(Tree& tree, std::vector<PutCommit>& puts) {
  const GilReleased released;
  for (PutCommit& put : puts) {
    try {
      tree.commit(put.request, put.stored);
    } catch (Rejected& rejected) {
      put.rejected = std::move(rejected);
    } catch (const std::bad_alloc&) {
      put.out_of_memory = true;
    }
  }
}

// None: all rows are stored. Bytes: what became of each row. Else why none is stored.
nb::object outcome_of(PutCommit& put) {
  if (put.rejected) return make_error(*put.rejected);
  if (put.out_of_memory) return make_memory_error();
  const auto is_stored = [](std::uint8_t result) { return result == RowResult::stored; };
  if (std::all_of(put.stored.begin(), put.stored.end(), is_stored)) return nb::none();
  return nb::bytes(reinterpret_cast<const char*>(put.stored.data()), put.stored.size());
}

nb::list commit_puts(Tree& tree, const nb::list& rows, const nb::list& authorities,
                     const nb::list& max_stamps, const std::optional<nb::list>& drop_strays) {
  const nb::tuple kept = tuple_of(rows), names = tuple_of(authorities);
  const nb::tuple latest = tuple_of(max_stamps);
  const nb::tuple strays = drop_strays ? tuple_of(*drop_strays) : nb::make_tuple();
  if (names.size() != kept.size() || latest.size() != kept.size() ||
      (drop_strays && strays.size() != kept.size()))
    raise_invalid("rows, authorities, max_stamps_ns and drop_strays must be equally long", "rows");
  std::vector<PutCommit> puts(kept.size());
  std::size_t total = 0;
  for (const nb::handle each : kept) total += nb::cast<const TransformRows&>(each).rows().size();
  std::vector<std::uint8_t> stored(total);
  std::span<std::uint8_t> unused(stored);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const auto& put_rows = nb::cast<const TransformRows&>(kept[i]);
    PutCommit& put = puts[i];
    put.request = {.names = put_rows.texts(),
                   .rows = put_rows.rows(),
                   .authority = text_of(names[i], "authority"),
                   .drop_old = true,
                   .drop_bad = true,
                   .drop_strays = !drop_strays || nb::cast<bool>(strays[i])};
    if (!latest[i].is_none()) put.request.max_stamp = nb::cast<Stamp>(latest[i]);
    put.stored = unused.first(put_rows.rows().size());
    unused = unused.subspan(put_rows.rows().size());
  }
  commit_each(tree, puts);
  nb::list outcomes;
  for (PutCommit& put : puts) outcomes.append(outcome_of(put));
  return outcomes;
}

}  // namespace

void bind_puts(nb::module_& m, nb::class_<Tree>& tree) {
  m.def("decode_puts", &decode_puts, nb::arg("messages"), nb::arg("max_rows"),
        nb::arg("max_decoded_bytes"));
  tree.def("_commit_puts", &commit_puts, nb::arg("rows"), nb::arg("authorities"),
           nb::arg("max_stamps_ns"), nb::arg("drop_strays").none() = nb::none());
}

}  // namespace ztf
