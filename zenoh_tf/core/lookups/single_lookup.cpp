#include "lookups/single_lookup.hpp"

#include <bit>
#include <cstring>

namespace ztf {

namespace {

using namespace std::string_view_literals;

// Columns are little-endian, and are copied as they are.
static_assert(std::endian::native == std::endian::little);

// MessagePack: 8n is a map of n fields, 9n a list, an a text of n bytes, d9 a text whose length
// follows, c4 a binary whose length follows.
constexpr std::string_view kNames =
    "\x86"
    "\xa1v\x01"
    "\xa5names\x92"sv;
constexpr std::string_view kOp = "\xa2op\xc4\x01"sv;
constexpr std::string_view kIndexes =
    "\xa6target\xc4\x04\0\0\0\0"
    "\xa6source\xc4\x04\1\0\0\0"sv;
constexpr std::string_view kStamp = "\xa5stamp\xc4\x08"sv;

constexpr std::string_view kSixFields = "\x86"sv, kSevenFields = "\x87"sv;
constexpr std::string_view kStatus = "\xa6status\xc4\x01\0"sv;
constexpr std::string_view kPose = "\xa4pose\xc4\x38"sv;
constexpr std::string_view kNoErrors =
    "\xa6"
    "errors\x90"sv;
constexpr std::string_view kNewest = "\xa6newest\xc4\x08"sv;
constexpr std::string_view kEnvelope =
    "\xa1v\x01"
    "\xa8instance"sv;

constexpr std::size_t kShortText = 31;
static_assert(sizeof(Pose) == 7 * sizeof(double));

class Writer {
 public:
  Writer& raw(std::string_view bytes) {
    out_.append(bytes);
    return *this;
  }
  template <class T>
  Writer& number(const T& value) {
    out_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Writer& text(std::string_view text) {
    if (text.size() <= kShortText) {
      out_.push_back(static_cast<char>(0xa0 | text.size()));
    } else {
      out_.push_back('\xd9');
      out_.push_back(static_cast<char>(text.size()));
    }
    return raw(text);
  }
  std::string take() { return std::move(out_); }

 private:
  std::string out_;
};

// Reads one part after the other. False: the message has other fields, and the slow path parses it.
class MessageReader {
 public:
  explicit MessageReader(std::string_view data) : rest_(data) {}

  bool raw(std::string_view bytes) {
    if (!rest_.starts_with(bytes)) return false;
    rest_.remove_prefix(bytes.size());
    return true;
  }
  template <class T>
  bool number(T& value) {
    if (rest_.size() < sizeof value) return false;
    std::memcpy(&value, rest_.data(), sizeof value);
    rest_.remove_prefix(sizeof value);
    return true;
  }
  bool text(std::string_view& text) {
    if (rest_.empty()) return false;
    const auto head = static_cast<unsigned char>(rest_[0]);
    std::size_t begin = 1, size = head & kShortText;
    if (head == 0xd9 && rest_.size() > 1) {
      begin = 2;
      size = static_cast<unsigned char>(rest_[1]);
    } else if ((head & ~kShortText) != 0xa0) {
      return false;
    }
    if (rest_.size() < begin + size) return false;
    text = rest_.substr(begin, size);
    rest_.remove_prefix(begin + size);
    return true;
  }
  [[nodiscard]] bool at_end() const { return rest_.empty(); }

 private:
  std::string_view rest_;
};

}  // namespace

std::optional<std::string> pack_single_lookup(const SingleLookup& lookup) {
  if (lookup.target.size() > kMaxSingleText || lookup.source.size() > kMaxSingleText) return {};
  return Writer()
      .raw(kNames)
      .text(lookup.target)
      .text(lookup.source)
      .raw(kOp)
      .number(lookup.op)
      .raw(kIndexes)
      .raw(kStamp)
      .number(lookup.stamp)
      .take();
}

std::optional<SingleLookup> parse_single_lookup(std::string_view message) {
  MessageReader reader(message);
  SingleLookup lookup;
  if (reader.raw(kNames) && reader.text(lookup.target) && reader.text(lookup.source) &&
      reader.raw(kOp) && reader.number(lookup.op) && reader.raw(kIndexes) && reader.raw(kStamp) &&
      reader.number(lookup.stamp) && reader.at_end())
    return lookup;
  return {};
}

std::optional<std::string> pack_single_answer(const SingleAnswer& answer,
                                              std::string_view instance) {
  if (instance.size() > kMaxSingleText) return {};
  Writer writer;
  writer.raw(answer.newest ? kSevenFields : kSixFields)
      .raw(kStatus)
      .raw(kStamp)
      .number(answer.stamp)
      .raw(kPose)
      .number(answer.pose)
      .raw(kNoErrors);
  if (answer.newest) writer.raw(kNewest).number(*answer.newest);
  return writer.raw(kEnvelope).text(instance).take();
}

std::optional<SingleAnswer> parse_single_answer(std::string_view message,
                                                std::string_view instance) {
  MessageReader reader(message);
  SingleAnswer answer;
  const bool has_newest = reader.raw(kSevenFields);
  if (!has_newest && !reader.raw(kSixFields)) return {};
  if (!reader.raw(kStatus) || !reader.raw(kStamp) || !reader.number(answer.stamp) ||
      !reader.raw(kPose) || !reader.number(answer.pose) || !reader.raw(kNoErrors))
    return {};
  if (has_newest && (!reader.raw(kNewest) || !reader.number(answer.newest.emplace()))) return {};
  std::string_view from;
  if (!reader.raw(kEnvelope) || !reader.text(from) || from != instance || !reader.at_end())
    return {};
  return answer;
}

}  // namespace ztf
