// Messages of others: what is whole is read, and what is cut or altered harms nothing.
#include "check.hpp"
#include "messages/cursor.hpp"
#include "messages/decoded_size.hpp"
#include "messages/put.hpp"
#include "messages/single_lookup.hpp"

using namespace ztf;
using namespace std::literals;

namespace {

constexpr PutLimits kLimits{16, 1 << 16};

template <class T>
std::string binary(const T& value) {
  std::string out = "\xc4";
  out.push_back(static_cast<char>(sizeof value));
  return out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

// The pose of `camera` in `map`, its names as given.
std::string put(const std::string& names =
                    "\x92\xa3map\xa6"
                    "camera") {
  return "\x86\xa1v\x01\xa5names" + names + "\xa6parent" + binary(std::uint32_t{0}) + "\xa5" +
         "child" + binary(std::uint32_t{1}) + "\xa5stamp" + binary(Stamp{7}) + "\xa4pose" +
         binary(Pose{1, 2, 3, 0, 0, 0, 1});
}

}  // namespace

TEST(a_put_and_its_pieces) {
  const std::string message = put();
  const auto parsed = parse_put(message, kLimits);
  CHECK(parsed && parsed->names == (std::vector{"map"sv, "camera"sv}));
  CHECK(parsed && parsed->rows.size() == 1 && parsed->rows[0].stamp == 7);
  CHECK(decoded_size(message) > 0);
  for (std::size_t size = 0; size < message.size(); ++size) {
    CHECK(!parse_put(std::string_view(message).substr(0, size), kLimits));
    CHECK_EQ(decoded_size(std::string_view(message).substr(0, size)), kMalformed);
  }
  CHECK(!parse_put(message + "\x01", kLimits));
  CHECK(!parse_put(message, {0, 1 << 16}));
  CHECK(!parse_put(message, {16, 100}));
}

TEST(names_of_a_put_are_utf8_and_as_many_as_said) {
  CHECK(parse_put(put("\x92\xa1x\xd9\x02\xc3\xa4"), kLimits));
  CHECK(parse_put(put("\xdc\x00\x02\xa1x\xa1y"s), kLimits));
  CHECK(!parse_put(put("\x92\xa1x\xa1\xff"), kLimits));
  CHECK(!parse_put(put("\x91\xa1x"), kLimits));                  // the child's index is 1
  CHECK(!parse_put(put("\xdd\xff\xff\xff\xff\xa1x"), kLimits));  // more than there can be
  CHECK(!parse_put(put("\x92\xa1x\xc4\x01y"), kLimits));         // binary
}

TEST(what_a_message_costs) {
  CHECK_EQ(decoded_size("\x07"), 0);
  CHECK_EQ(decoded_size("\xcd\x01\x02"), 32);
  CHECK_EQ(decoded_size("\xa3"
                        "abc"),
           59);
  CHECK_EQ(decoded_size("\xc1"), kMalformed);
  CHECK_EQ(decoded_size("\xdd\xff\xff\xff\xff"), kMalformed);
  CHECK_EQ(decoded_size(std::string(40, '\x91') + '\x01'), kTooDeep);
}

TEST(a_single_lookup_and_its_answer) {
  const std::string request = *pack_single_lookup({"map", "base", Op::at, 42});
  const auto lookup = parse_single_lookup(request);
  CHECK(lookup && lookup->target == "map" && lookup->source == "base" && lookup->stamp == 42);
  const std::string reply = *pack_single_answer({42, Stamp{50}, Pose{1}}, "server");
  const auto answer = parse_single_answer(reply, "server");
  CHECK(answer && answer->stamp == 42 && answer->newest == 50 && answer->pose.x == 1);
  CHECK(!parse_single_answer(reply, "another"));
  for (std::size_t size = 0; size < request.size(); ++size)
    CHECK(!parse_single_lookup(std::string_view(request).substr(0, size)));
}
