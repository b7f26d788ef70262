// Names that come and go while others look for names: none is missed, none is taken for another.
#include <random>

#include "check.hpp"
#include "owned_memory.hpp"
#include "thread_group.hpp"

using namespace ztf;

namespace {

// Short and long ones, of which many share their beginning.
std::string name_of(int n) {
  return std::string(n % 2 ? 0 : 20 + static_cast<std::size_t>(n % 30), 'x') + "name" +
         std::to_string(n);
}

}  // namespace

TEST(readers_find_names_that_stay_while_others_come_and_go) {
  constexpr int kStay = 20, kChange = 40, kRounds = 20'000;
  OwnedNames table(kStay + kChange);
  for (int n = 0; n < kStay; ++n) table.insert(name_of(n));
  ThreadGroup threads;
  threads.background(2, [&](int reader, const std::atomic<bool>& stop) {
    std::minstd_rand random(static_cast<unsigned>(reader) + 1);
    while (!stop) {
      const int n = static_cast<int>(random() % kStay);
      CHECK_EQ(table.find(name_of(n)), static_cast<NameTable::Id>(n + 1));
      const NameTable::Id id = kStay + 1 + random() % kChange;
      const std::string name = table.name(id);
      if (name.empty()) continue;  // never used yet
      CHECK(name == name_of(std::stoi(name.substr(name.find("name") + 4))));
      const NameTable::Id found = table.find(name);
      CHECK(found == 0 || found > kStay);
    }
  });
  threads.foreground([&] {
    std::minstd_rand random(7);
    std::vector<int> there;
    for (int n = kStay; n < kStay + kRounds; ++n) {
      if (there.size() == kChange || (!there.empty() && random() % 3 == 0)) {
        const std::size_t i = random() % there.size();
        const NameTable::Id id = table.find(name_of(there[i]));
        CHECK(id != 0);
        table.free(id);
        there.erase(there.begin() + static_cast<std::ptrdiff_t>(i));
      }
      table.insert(name_of(n));
      there.push_back(n);
    }
  });
  threads.join();
}
