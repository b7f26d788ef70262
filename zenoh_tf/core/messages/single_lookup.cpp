#include "messages/single_lookup.hpp"

#include <bit>

#include "messages/cursor.hpp"
#include "messages/writer.hpp"

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

static_assert(sizeof(Pose) == 7 * sizeof(double));

}  // namespace

std::optional<std::string> pack_single_lookup(const SingleLookup& lookup) {
  if (lookup.target.size() > kMaxSingleText || lookup.source.size() > kMaxSingleText) return {};
  return MessageWriter()
      .raw(kNames)
      .text(lookup.target)
      .text(lookup.source)
      .raw(kOp)
      .entry(lookup.op)
      .raw(kIndexes)
      .raw(kStamp)
      .entry(lookup.stamp)
      .take();
}

std::optional<SingleLookup> parse_single_lookup(std::string_view message) {
  MessageCursor cursor(message);
  SingleLookup lookup;
  if (cursor.raw(kNames) && cursor.text(lookup.target) && cursor.text(lookup.source) &&
      cursor.raw(kOp) && cursor.entry(lookup.op) && cursor.raw(kIndexes) && cursor.raw(kStamp) &&
      cursor.entry(lookup.stamp) && cursor.at_end())
    return lookup;
  return {};
}

std::optional<std::string> pack_single_answer(const SingleAnswer& answer,
                                              std::string_view instance) {
  if (instance.size() > kMaxSingleText) return {};
  MessageWriter writer;
  writer.raw(answer.newest ? kSevenFields : kSixFields)
      .raw(kStatus)
      .raw(kStamp)
      .entry(answer.stamp)
      .raw(kPose)
      .entry(answer.pose)
      .raw(kNoErrors);
  if (answer.newest) writer.raw(kNewest).entry(*answer.newest);
  return writer.raw(kEnvelope).text(instance).take();
}

std::optional<SingleAnswer> parse_single_answer(std::string_view message,
                                                std::string_view instance) {
  MessageCursor cursor(message);
  SingleAnswer answer;
  const bool has_newest = cursor.raw(kSevenFields);
  if (!has_newest && !cursor.raw(kSixFields)) return {};
  if (!cursor.raw(kStatus) || !cursor.raw(kStamp) || !cursor.entry(answer.stamp) ||
      !cursor.raw(kPose) || !cursor.entry(answer.pose) || !cursor.raw(kNoErrors))
    return {};
  if (has_newest && (!cursor.raw(kNewest) || !cursor.entry(answer.newest.emplace()))) return {};
  std::string_view from;
  if (!cursor.raw(kEnvelope) || !cursor.text(from) || from != instance || !cursor.at_end())
    return {};
  return answer;
}

}  // namespace ztf
