// The table of names, and the hash that spreads them.
#include <set>
#include <string>
#include <vector>

#include "fixture.hpp"
#include "owned_memory.hpp"

using namespace ztf;

namespace {

// Names as robots have them: most of each is the same.
std::vector<std::string> frames_of_a_fleet() {
  std::vector<std::string> names;
  for (int robot = 0; robot < 200; ++robot)
    for (int link = 0; link < 100; ++link)
      names.push_back(nth("robot_", robot) + "/arm/link_" + std::to_string(link));
  return names;
}

}  // namespace

TEST(every_byte_of_a_name_and_its_length_count) {
  const NameHash hash;
  for (std::size_t length = 0; length <= 70; ++length) {
    std::string name(length, 'a');
    std::set<std::uint64_t> seen{hash(name), hash(name + 'a')};
    for (std::size_t at = 0; at < length; ++at)
      for (const char other : {'b', 'A', '\0', '\xff'}) {
        name[at] = other;
        seen.insert(hash(name));
        name[at] = 'a';
      }
    CHECK_EQ(seen.size(), 2 + 4 * length);
  }
}

TEST(names_spread_over_the_slots_of_a_table) {
  const std::vector<std::string> names = frames_of_a_fleet();
  const NameHash hash;
  constexpr std::size_t kSlots = 1 << 16;
  std::vector<int> lower(kSlots), upper(kSlots);
  std::size_t lower_collisions = 0, upper_collisions = 0;
  for (const std::string& name : names) {
    lower_collisions += lower[hash(name) % kSlots]++ != 0;  // chooses the slot
    upper_collisions += upper[hash(name) >> 48]++ != 0;     // distinguishes names in one slot
  }
  // By chance 2,770 of the 20,000 names find their slot taken, give or take 50.
  CHECK(lower_collisions > 2300 && lower_collisions < 3300);
  CHECK(upper_collisions > 2300 && upper_collisions < 3300);
}

TEST(numbered_names_spread_with_every_seed) {
  constexpr std::size_t kNames = 1000, kSlots = 2048;
  for (const char* const series : {"frame", "robot_1/link_", "a"})
    for (std::uint64_t seed = 1; seed <= 1000; ++seed) {
      const NameHash hash(seed * 0x9e3779b97f4a7c15, seed * 0xd1342543de82ef95);
      std::vector<bool> lower(kSlots), upper(kSlots);
      std::size_t taken = 0;
      for (std::size_t n = 0; n < kNames; ++n) {
        const std::uint64_t value = hash(series + std::to_string(n));
        taken += lower[value % kSlots] + upper[(value >> 32) % kSlots];
        lower[value % kSlots] = upper[(value >> 32) % kSlots] = true;
      }
      CHECK(taken < 540);  // by chance 418, give or take 17
    }
}

TEST(each_table_hashes_with_a_seed_of_its_own) { CHECK(NameHash()("map") != NameHash()("map")); }

TEST(several_names_are_found_as_each_by_itself) {
  const std::vector<std::string> names = frames_of_a_fleet();
  OwnedNames table(static_cast<std::uint32_t>(names.size()));
  std::vector<std::string_view> asked;
  const auto check = [&] {
    std::vector<NameTable::Id> ids(asked.size() + 1, 77);
    table.find_each(asked, ids.data());
    for (std::size_t i = 0; i < asked.size(); ++i) CHECK_EQ(ids[i], table.find(asked[i]));
    CHECK_EQ(ids.back(), 77u);
  };
  check();
  // More than are looked up at a time, among them unknown, removed and repeated names.
  for (std::size_t i = 0; i < 100; ++i) asked.push_back(names[i * 7919 % names.size()]);
  asked.insert(asked.end(), {names[0], "", "robot_1/arm/link_", names[0]});
  for (std::size_t i = 0; i < names.size() / 2; ++i) table.insert(names[i]);
  check();
  for (std::size_t i = names.size() / 2; i < names.size(); ++i) table.insert(names[i]);
  table.remove(1);
  check();
  CHECK_EQ(table.find(asked.back()), 0u);
  table.restore(1);
  check();
}

TEST(removed_names_give_their_ids_and_slots_back) {
  OwnedNames table(100);
  const auto name = [](int n) {
    return std::string(static_cast<std::size_t>(n % 50), 'a' + n % 3) + std::to_string(n);
  };
  for (int n = 0; n < 100; ++n) table.insert(name(n));
  CHECK_EQ(table.left(), 0u);
  for (int n = 100; n < 100'000; ++n) {
    const int old = n - 100;
    const NameTable::Id id = table.find(name(old));
    CHECK(id != 0);
    table.free(id);
    CHECK_EQ(table.find(name(old)), 0u);
    CHECK_EQ(table.left(), 1u);
    CHECK_EQ(table.next_id(), id);
    CHECK_EQ(table.insert(name(n)), id);
    CHECK(table.name(id) == name(n));
    CHECK_EQ(table.find(name(old)), 0u);
    CHECK_EQ(table.find(name(n)), id);
  }
  CHECK_EQ(table.size(), 100u);
  for (int n = 100'000 - 100; n < 100'000; ++n) CHECK(table.name(table.find(name(n))) == name(n));
}

// Otherwise a search for a name that does not exist would visit the whole table.
TEST(some_slots_stay_empty_however_often_names_come_and_go) {
  constexpr std::uint32_t kNames = 1000;  // nearly half of 2,048 slots
  OwnedNames table(kNames);
  std::uint32_t random = 1, n = 0;
  while (n < kNames) table.insert(nth("frame", n++));
  for (; n < 50 * kNames; ++n) {
    random = random * 1664525 + 1013904223;
    table.free(1 + (random >> 8) % kNames);
    table.insert(nth("frame", n));
    CHECK(table.used_slots() * 4 <= table.slots() * 3);
  }
  CHECK(table.used_slots() >= kNames && table.slots() <= 8 * kNames);
}
