// Changes and frames as messages: what is written is read, and what is cut or altered harms
// nothing.
#include "replication/message.hpp"

#include "base/rejected.hpp"
#include "check.hpp"

using namespace ztf;
using namespace std::literals;

namespace {

ChangeTable some_changes() {
  ChangeTable table;
  const std::uint32_t map = table.names.add("map"), base = table.names.add("base");
  table.add(ChangeKind::sample, base, 4);
  table.add_sample(map, table.authorities.add("wheels"), 7, {1, 2, 3, 0, 0, 0, 1});
  table.add(ChangeKind::orphaned, base, 8);
  table.lost.push_back(kNoParent);
  table.add(ChangeKind::removed, map, 12);
  return table;
}

FrameTable some_frames() {
  FrameTable table;
  table.frame = {table.names.add("base"), table.names.add("map")};
  table.version = {8, 4};
  table.is_static = {0, 0};
  table.authority = {table.authorities.add("wheels"), table.authorities.add("")};
  table.count = {2, 0};
  table.stamp = {7, 9};
  table.parent = {1, kNoParent};
  table.pose = {{1, 2, 3, 0, 0, 0, 1}, {4, 5, 6, 0, 0, 0, 1}};
  return table;
}

template <class Body>
bool is_rejected(Body&& body) {
  try {
    body();
    return false;
  } catch (const Rejected&) {
    return true;
  }
}

template <auto parse>
void check_message(const std::string& message) {
  CHECK(pack(parse(message).columns) == message);
  for (std::size_t size = 0; size < message.size(); ++size)
    CHECK(is_rejected([&] { (void)parse(std::string_view(message).substr(0, size)); }));
  std::size_t rejected = 0;
  const auto values = {0x00, 0x7f, 0x80, 0x91, 0xa1, 0xc4, 0xc6, 0xdd, 0xff};
  for (std::size_t at = 0; at < message.size(); ++at)
    for (const int value : values) {
      std::string altered = message;
      altered[at] = static_cast<char>(value);
      rejected += is_rejected([&] { (void)parse(altered); });
    }
  CHECK(rejected > message.size() && rejected < message.size() * values.size());
}

}  // namespace

TEST(changes_are_read_as_they_were_written) {
  check_message<parse_changes>(pack(some_changes().view()));
}

TEST(frames_are_read_as_they_were_written) {
  check_message<parse_frames>(pack(some_frames().view()));
}

TEST(what_no_tree_can_have_is_not_replayed) {
  check_replayable(some_changes().view(), {});
  check_replayable(some_frames().view(), {});
  const auto is_refused = [](auto&& change, const Options& options = {}) {
    FrameTable table = some_frames();
    change(table);
    return is_rejected([&] { check_replayable(table.view(), options); });
  };
  CHECK(is_refused([](FrameTable&) {}, {.max_name_bytes = 3}));
  CHECK(is_refused([](FrameTable& t) { t.names.add(""); }));
  CHECK(is_refused([](FrameTable& t) { t.names.add("/a"); }));
  CHECK(is_refused([](FrameTable& t) { t.names.add("a\0"sv); }));
  CHECK(is_refused([](FrameTable& t) { t.version[0] = 0; }));
  CHECK(is_refused([](FrameTable& t) { t.version[0] |= SeqLock::kWriting; }));
  CHECK(is_refused([](FrameTable& t) { t.pose[1].qw = 2; }));
  CHECK(is_refused([](FrameTable& t) { t.stamp[1] = 7; }));
  CHECK(is_refused([](FrameTable& t) { t.is_static[0] = 1; }));
}
