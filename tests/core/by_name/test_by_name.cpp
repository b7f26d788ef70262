// Lookups by names, and how they say that they failed.
#include "by_name/rows.hpp"
#include "by_name/stamp_units.hpp"
#include "fixture.hpp"

using namespace ztf;

namespace {

struct Columns {
  std::vector<std::uint8_t> op;
  std::vector<std::uint32_t> target, source;
  std::vector<Stamp> stamp;
};

LookupRows rows_of(std::vector<std::string_view> names, const Columns& columns) {
  LookupRows rows(std::move(names));
  rows.size = columns.op.size();
  rows.op = {columns.op.data()};
  rows.target = {columns.target.data()};
  rows.source = {columns.source.data()};
  rows.stamp = {columns.stamp.data()};
  return rows;
}

std::string text_of(const World& w, NamedQuery query, const LookupNote& note = {}) {
  Answer answer;
  lookup(w.tree, query, answer);
  return answer.failure.code == Code::ok
             ? ""
             : lookup_error(w.tree, answer.failure, query, note).message;
}

}  // namespace

TEST(an_error_names_what_is_missing) {
  World w;
  w.set("map", "base", 2'000);
  w.set("map", "base", 5'000);
  CHECK_EQ(text_of(w, {{.op = Op::at, .stamp = 3'000}, "map", "base"}), "");
  CHECK_EQ(text_of(w, {{.op = Op::at, .stamp = 3'000}, "map", "bse"}),
           "frame 'bse' does not exist; did you mean 'base'?");
  const NamedQuery late{{.op = Op::at, .stamp = 9'000}, "map", "base"};
  std::string text = text_of(w, late, {.may_wait = true});
  CHECK(text.starts_with("extrapolation into the future: the link from 'map' to 'base'"));
  CHECK(text.ends_with("(4 us too late); give the lookup a time-out to wait for the next sample"));
  w.tree.set_recorded(true);
  text = text_of(w, late, {.may_wait = true});
  CHECK(text.ends_with("(4 us too late)"));
  CHECK(
      text_of(w, late, {.waited = waited_for(1.5)}).ends_with("(4 us too late, waited for 1.5 s)"));
}

TEST(a_lookup_of_two_times_names_the_half_that_failed) {
  World w;
  w.set("map", "base", 2'000);
  w.set("map", "base", 5'000);
  w.set("map", "arm", 2'000);
  w.set("map", "arm", 8'000);
  NamedQuery query{{.op = Op::full, .stamp = 3'000, .source_stamp = 9'000}, "base", "arm", "map"};
  CHECK(text_of(w, query).find("'arm' in 'map'") != std::string::npos);
  query.stamp = 7'000, query.source_stamp = 3'000;
  CHECK(text_of(w, query).find("'map' in 'base'") != std::string::npos);
}

TEST(rows_with_names_that_no_frame_can_have_fail_alone) {
  World w;
  w.set("map", "base", 2'000);
  const Columns columns{{0, 0, 0}, {0, 0, 1}, {1, 2, 3}, {2'000, 2'000, 2'000}};
  LookupRows rows = rows_of({"map", "base", "", "/base"}, columns);
  rows.check();
  (void)rows.find_names(w.tree);
  std::vector<Code> codes;
  rows.look_up_each(w.tree, [&](std::size_t first, std::span<const Answer> answers) {
    CHECK_EQ(first, 0u);
    for (const Answer& answer : answers) codes.push_back(answer.failure.code);
  });
  CHECK_EQ(codes.size(), 3u);
  CHECK(codes[0] == Code::ok && codes[1] == Code::lookup && codes[2] == Code::lookup);
  CHECK(!rows.fault(0));
  CHECK_EQ(rows.fault(1)->message, "source_frame is empty");
  CHECK(rows.fault(2)->message.ends_with("'/base' is spelled 'base'"));
  CHECK(rows.unknown_names().empty());
}

TEST(rows_that_are_malformed_are_rejected) {
  for (const Columns& columns :
       {Columns{{6}, {0}, {0}, {1}}, Columns{{0}, {1}, {0}, {1}}, Columns{{0}, {0}, {7}, {1}},
        Columns{{0}, {0}, {0}, {kNoStamp}}, Columns{{5}, {0}, {0}, {1}}}) {
    const LookupRows rows = rows_of({"map"}, columns);
    const auto rejected = rejection([&] { rows.check(); });
    CHECK(rejected && rejected->code == Code::invalid_argument);
  }
}

TEST(stamps_in_another_unit) {
  constexpr Stamp kNow = 1'790'000'000'123'456'789;
  CHECK_EQ(std::string(other_unit(kNow / 1'000'000'000, kNow, kNow)), "seconds");
  CHECK_EQ(std::string(other_unit(kNow / 1'000, kNow - 5, kNow)), "microseconds");
  CHECK(!other_unit(kNow - 1'000, kNow, kNow) && !other_unit(0, kNow, kNow));
  CHECK_EQ(age(850'999), "850 us");
  CHECK_EQ(age(-3.44e9), "-3.4 s");
  CHECK_EQ(age(56.9 * 365.25 * 86'400e9), "56.9 years");
}
