// Commits: atomic, in order of time, within the limits.
#include "commits/validation.hpp"
#include "fixture.hpp"

using namespace ztf;

namespace {

void check_refused(World& w, Code code, const std::string& field, const std::vector<Set>& sets,
                   const SetOptions& options = {}) {
  const std::string before = w.state();
  const std::uint64_t epoch = w.tree.commits();
  const auto refused = w.commit(sets, options);
  CHECK(refused.has_value());
  if (refused) {
    CHECK_EQ(refused->code, code);
    CHECK_EQ(refused->field, field);
  }
  CHECK_EQ(w.state(), before);
  CHECK_EQ(w.tree.commits(), epoch);
}

}  // namespace

TEST_EACH_MODE(bad_rows_leave_nothing_behind) {
  World w(c);
  w.set("a", "b", 100'000'000'000);
  const double nan = std::nan(""), inf = INFINITY;
  const Set good{"new1", "new2", 1};
  const Code bad = Code::invalid_argument;
  check_refused(w, bad, "child_frame", {good, {"x", "x", 1}});
  check_refused(w, bad, "child_frame", {good, {"x", "/x", 1}});
  check_refused(w, bad, "child_frame", {good, {"x", "", 1}});
  check_refused(w, bad, "parent_frame", {good, {"/", "x", 1}});
  check_refused(w, bad, "stamp_ns", {good, {"x", "y", kNoStamp}});
  check_refused(w, bad, "translation", {good, {"x", "y", 1, at_x(nan)}});
  check_refused(w, bad, "translation", {good, {"x", "y", 1, at_x(-inf)}});
  check_refused(w, bad, "rotation", {good, {"x", "y", 1, {0, 0, 0, 0, 0, 0, nan}}});
  check_refused(w, bad, "rotation", {good, {"x", "y", 1, {0, 0, 0, 0, 0, 0, 0}}});
  check_refused(w, bad, "rotation", {good, {"x", "y", 1, {0, 0, 0, 0, 0, 0, 1.01}}});
  check_refused(w, bad, "rotation", {good, {"x", "y", 1, {0, 0, 0, 1e200, 0, 0, 1}}});
  check_refused(w, bad, "stamp_ns", {good, {"a", "b", 89'999'999'999}});
  check_refused(w, bad, "parent_frame", {good, {"b", "a", 1}});
  check_refused(w, Code::conflict, "", {good}, {.reads = {{"b", 12345}}});
  check_refused(w, Code::limit, "max_name_bytes", {good, {"x", std::string(256, 'y'), 1}});
  w.accept({good, {"/x", "/y", 1, {0, 0, 0, 0, 0, 0, 1.004}}});
  CHECK_EQ(w.at("x", "y", 1).pose.qw, 1);
  CHECK_EQ(w.tree.size(), 6u);
  CHECK_EQ(w.tree.name(4), "new1");  // the child was numbered first
}

TEST(old_rows_are_dropped_or_refuse) {
  World w(Options{.cache_ns = 10});
  w.set("a", "b", 100, at_x(100));
  CHECK(w.set("a", "b", 90, at_x(90)));
  CHECK(!w.set("a", "b", 89));
  CHECK_EQ(w.events("b").dropped.load(), 1u);
  std::vector<std::uint8_t> stored;
  CHECK(!w.commit({{"a", "b", 89}, {"a", "c", 1}, {"a", "b", 101, at_x(101)}}, {.drop_old = true},
                  &stored));
  const std::vector<std::uint8_t> expected = {0, 1, 1};
  CHECK(stored == expected);
  CHECK_EQ(w.info("b").oldest, 100);
  check_refused(w, Code::invalid_argument, "stamp_ns",
                {{"a", "b", 102}, {"a", "b", 90}, {"a", "d", 1}});
}

// A row for which a full frame has no room is reported as not stored.
TEST_EACH_MODE(a_full_frame_refuses_older_rows) {
  World w(Options{.concurrency = c, .max_samples_per_frame = 4});
  for (Stamp t = 1; t <= 4; ++t) w.set("a", "b", 10 * t);
  check_refused(w, Code::invalid_argument, "stamp_ns", {{"a", "b", 5}, {"a", "c", 5}});
  CHECK(!w.set("a", "b", 5));
  CHECK_EQ(w.events("b").dropped.load(), 1u);
  CHECK(w.set("a", "b", 10, at_x(1)));
  CHECK(w.set("a", "b", 15));
  CHECK_EQ(w.info("b").oldest, 15);
  CHECK_EQ(w.info("b").evicted, 1u);
  check_refused(w, Code::invalid_argument, "stamp_ns", {{"a", "b", 14}, {"a", "b", 60}});
}

TEST_EACH_MODE(a_sample_at_the_newest_stamp_rewrites_it) {
  World w(c);
  w.set("a", "b", 1, at_x(1));
  w.set("a", "b", 1, at_x(2));
  CHECK_EQ(w.at("a", "b", 1).pose.x, 2);
  CHECK_EQ(w.info("b").samples, 1u);
  CHECK_EQ(w.events("b").rewritten.load(), 1u);
}

// Two samples that are far too old, one after the other, show that time was set back.
TEST_EACH_MODE(a_history_begins_again_after_a_second_late_sample) {
  World w(Options{.cache_ns = 10, .concurrency = c, .clear_on_time_jump = true});
  for (Stamp t = 1000; t < 1004; ++t) w.set("a", "b", t);
  CHECK(!w.set("a", "b", 100));
  CHECK(!w.set("a", "b", 100));  // it is no newer
  w.set("a", "b", 1005);         // all is well
  CHECK(!w.set("a", "b", 101));
  CHECK(!w.set("a", "b", 112));  // more than the cache time apart
  CHECK_EQ(w.info("b").newest, 1005);
  CHECK(w.set("a", "b", 113, at_x(7)));
  const FrameInfo info = w.info("b");
  CHECK(info.samples == 1 && info.oldest == 113 && info.newest == 113);
  CHECK_EQ(w.code(Op::at, "a", "b", 1003), Code::no_data);
  CHECK_EQ(w.ask(Op::latest, "a", "b").pose.x, 7);
  CHECK_EQ(w.events("b").time_jumps.load(), 1u);
  CHECK(w.set("a", "b", 114));
  CHECK_EQ(w.info("b").samples, 2u);
}

// Whatever its stamp is, as a static link counts at all times.
TEST_EACH_MODE(a_static_link_replaces_newer_samples) {
  World w(c);
  w.set("a", "b", 100);
  CHECK(w.set("c", "b", 50, at_x(3), true));
  CHECK_EQ(w.tree.parent(w.id("b"), kNoStamp), w.id("c"));
  CHECK_EQ(w.events("b").reparented.load(), 1u);
  check_refused(w, Code::invalid_argument, "parent_frame", {{"b", "c", 1}});
  w.accept({{"b", "a", 1}});  // it is no parent of b any more
}

TEST_EACH_MODE(unsorted_and_duplicate_rows) {
  World w(c);
  w.accept({{"z", "y", 3, at_x(3)},
            {"y", "x", 1, at_x(10)},
            {"z", "y", 1, at_x(1)},
            {"root", "z", 9},
            {"z", "y", 2, at_x(-1)},
            {"z", "y", 2, at_x(2)}});
  for (Stamp t = 1; t <= 3; ++t) CHECK_EQ(w.at("z", "y", t).pose.x, static_cast<double>(t));
  CHECK_EQ(w.ask(Op::latest_xact, "root", "x").pose.x, 13);
  // Of several static rows the newest one wins.
  w.accept({{"s", "t", 2, at_x(2)}, {"s", "t", 1, at_x(1)}}, {.is_static = true});
  CHECK_EQ(w.at("s", "t", 0).pose.x, 2);
  CHECK_EQ(w.info("y").version, kVersionStep);  // one commit, one version
}

TEST_EACH_MODE(cycles_are_refused) {
  World w(c);
  w.set("a", "b", 1);
  w.set("b", "c", 1);
  const Code bad = Code::invalid_argument;
  check_refused(w, bad, "parent_frame", {{"c", "a", 1}});
  check_refused(w, bad, "parent_frame", {{"b", "a", 1}}, {.is_static = true});
  check_refused(w, bad, "parent_frame", {{"d", "a", 1}, {"c", "d", 1}});
  check_refused(w, bad, "parent_frame", {{"p", "q", 1}, {"q", "r", 1}, {"r", "p", 1}});
  check_refused(w, bad, "parent_frame", {{"p", "q", 1}, {"q", "p", 1}});
  // All rows of a commit take effect at once: reversing a chain closes no cycle.
  w.accept({{"c", "b", 2}, {"b", "a", 2}, {"r", "c", 2}});
  CHECK_EQ(w.code(Op::latest_xact, "r", "a"), Code::ok);
  // Only the newest parent of each matters.
  w.accept({{"a", "r", 1}, {"top", "r", 5}});
  // A sample older than the newest changes no topology.
  w.accept({{"a", "r", 3}});
  CHECK_EQ(w.tree.parent(w.id("r"), kNoStamp), w.id("top"));
  CHECK_EQ(w.events("a").reparented.load(), 0u);
  CHECK_EQ(w.events("b").reparented.load(), 1u);
}

TEST(the_frame_limit) {
  World w(Options{.max_frames = 3});
  w.set("a", "b", 1);
  check_refused(w, Code::limit, "max_frames", {{"c", "d", 1}});
  CHECK(w.set("b", "c", 1));
  check_refused(w, Code::limit, "max_frames", {{"c", "d", 1}});
  CHECK(w.set("b", "c", 2));
}

TEST(messages_name_the_value_and_the_limit) {
  CHECK_EQ(with_separators(0), "0");
  CHECK_EQ(with_separators(999), "999");
  CHECK_EQ(with_separators(1'048'576), "1,048,576");
  World w(
      Options{.cache_ns = 10, .max_frames = 3, .max_samples_per_frame = 2, .max_authorities = 1});
  w.set("a", "b", 100);
  const auto message = [&](const std::vector<Set>& sets, const SetOptions& options = {}) {
    const auto rejected = w.commit(sets, options);
    return rejected ? rejected->message : std::string();
  };
  CHECK_EQ(message({{"b", "c", 1}, {"c", "d", 1}}),
           "cannot create frame 'd': the limit of 3 frames is reached (max_frames)");
  CHECK_EQ(message({{"a", "b", 89}}),
           "cannot set the transform of child 'b' in parent 'a': the stamp 89 ns is older than the "
           "newest sample's, 100 ns, by more than the cache time of 10 ns");
  w.set("a", "b", 101);
  CHECK_EQ(message({{"a", "b", 99}}),
           "cannot set the transform of child 'b' in parent 'a': the stamp 99 ns is older than all "
           "samples of the frame, which is full: it has 2 (max_samples_per_frame), from 100 ns on");
  w.accept({{"a", "b", 102}}, {.authority = "one"});
  CHECK_EQ(message({{"a", "b", 103}}, {.authority = "two"}),
           "cannot add authority 'two': the limit of 1 authorities is reached (max_authorities)");
}

TEST(one_authority_per_frame) {
  World w(Options{.one_authority_per_frame = true});
  w.accept({{"a", "b", 1}}, {.authority = "me"});
  w.accept({{"a", "b", 2}}, {.authority = "me"});
  check_refused(w, Code::invalid_argument, "authority", {{"a", "b", 3}}, {.authority = "you"});
  check_refused(w, Code::invalid_argument, "authority", {{"a", "b", 3}});
  w.accept({{"b", "c", 1}}, {.authority = "you"});
  CHECK_EQ(w.tree.authority(w.info("b").authority), "me");
  w.tree.clear(true);
  w.accept({{"a", "b", 3}}, {.authority = "you"});
}

TEST(authorities_are_counted_and_limited) {
  World w(Options{.max_authorities = 2});
  w.accept({{"a", "b", 1}}, {.authority = "one"});
  w.accept({{"a", "b", 2}}, {.authority = "two"});
  CHECK_EQ(w.events("b").authority_changes.load(), 1u);
  w.accept({{"a", "c", 1}}, {.authority = "one"});
  // Both own a frame now.
  check_refused(w, Code::limit, "max_authorities", {{"a", "b", 3}}, {.authority = "three"});
  check_refused(w, Code::limit, "max_name_bytes", {{"a", "b", 3}},
                {.authority = std::string(256, 'x')});
}

TEST(a_dropped_row_counts_for_its_authority_and_changes_nothing) {
  World w(Options{.cache_ns = 10});
  w.accept({{"a", "b", 100}}, {.authority = "me"});
  const Version before = w.info("b").version;
  w.accept({{"a", "b", 50}}, {.authority = "you", .drop_old = true});
  const AuthorityCounts me = w.tree.authority_counts(w.info("b").authority),
                        you = w.tree.authority_counts(2);
  CHECK(me.stored == 1 && me.dropped == 0 && you.stored == 0 && you.dropped == 1);
  CHECK_EQ(w.tree.authority(w.info("b").authority), "me");
  CHECK_EQ(w.events("b").authority_changes.load(), 0u);
  CHECK_EQ(w.info("b").version, before);
}

TEST_EACH_MODE(read_versions_must_still_stand) {
  World w(c);
  w.set("a", "b", 1, at_x(1));
  w.set("b", "c", 1, at_x(1));
  Answer a;
  auto reads = w.reads_of(w.query(Op::latest_xact, "a", "c"), a);
  CHECK_EQ(reads.size(), 2u);
  w.accept({{"a", "d", 1}}, {.reads = reads});
  w.accept({{"a", "b", 2}}, {.reads = reads});  // both read and written
  check_refused(w, Code::conflict, "", {{"a", "d", 2}}, {.reads = reads});
  // The read set of a failed lookup is validated, too.
  reads = w.reads_of(w.query(Op::at, "a", "c", 50), a);
  CHECK_EQ(a.failure.code, Code::no_data);
  w.accept({{"a", "e", 1}}, {.reads = reads});
  w.set("b", "c", 50);
  check_refused(w, Code::conflict, "", {{"a", "e", 2}}, {.reads = reads});
  const auto cleared = w.reads_of(w.query(Op::latest_xact, "a", "c"), a);
  w.tree.clear(true);
  check_refused(w, Code::conflict, "", {{"a", "e", 3}}, {.reads = cleared});
}

// While no frame has had two parents, readers use one path for all times. So a transaction that
// read anything before the first reparenting must not commit after it.
TEST_EACH_MODE(the_first_frame_of_two_parents_changes_all) {
  World w(c);
  w.accept({{"r", "a", 1}, {"r", "b", 1}, {"r", "q", 1}, {"r", "fixed", 1}});
  Answer answer;
  const auto reads = w.reads_of(w.query(Op::latest_common, "r", "a"), answer);
  w.accept({{"q", "fixed", 1}}, {.is_static = true});  // a static link has no history
  w.set("r", "grasped", 1);
  w.set("q", "grasped", 1 + Stamp{20'000'000'000});  // by then the older sample is too old
  CHECK_EQ(w.refusal({{"r", "q", 2}, {"q", "r", 2}, {"q", "b", 2}}), Code::invalid_argument);
  w.accept({{"r", "c", 2}}, {.reads = reads});
  w.accept({{"q", "b", 2}});
  CHECK_EQ(w.refusal({{"r", "c", 3}}, {.reads = reads}), Code::conflict);
  const auto again = w.reads_of(w.query(Op::latest_common, "r", "a"), answer);
  w.accept({{"q", "a", 2}, {"r", "b", 3}});
  w.accept({{"r", "a", 3}, {"r", "c", 3}});
  const auto later = w.reads_of(w.query(Op::latest_common, "r", "b"), answer);
  w.accept({{"r", "a", 4}});
  w.accept({{"r", "c", 4}}, {.reads = later});  // only the first one does that
  CHECK_EQ(w.refusal({{"r", "c", 5}}, {.reads = again}), Code::conflict);
}

// Version 0 says that a frame did not exist. A frame exists as soon as it is a parent.
TEST_EACH_MODE(a_name_that_was_unknown_must_still_be) {
  World w(c);
  w.set("a", "b", 1);
  w.accept({{"a", "b", 2}}, {.reads = {{"x", 0}}});
  w.accept({{"x", "y", 2}}, {.reads = {{"x", 0}, {"y", 0}}});
  check_refused(w, Code::conflict, "", {{"a", "b", 3}}, {.reads = {{"x", 0}}});
  check_refused(w, Code::conflict, "", {{"a", "b", 3}}, {.reads = {{"y", 0}}});
}

TEST_EACH_MODE(clear_keeps_names_and_static_links) {
  World w(c);
  w.set("a", "b", 1, at_x(1), true);
  w.set("b", "c", 5);
  w.set("b", "c", 6);
  w.tree.clear(true);
  CHECK_EQ(w.tree.size(), 3u);
  CHECK_EQ(w.at("a", "b", 5).pose.x, 1);
  CHECK_EQ(w.code(Op::latest_common, "b", "c"), Code::connectivity);
  CHECK_EQ(w.code(Op::at, "b", "c", 6), Code::connectivity);
  CHECK_EQ(w.info("c").samples, 0u);
  CHECK(w.set("b", "c", 1));  // nothing newer is remembered
  CHECK_EQ(w.code(Op::at, "b", "c", 1), Code::ok);
  w.tree.clear(false);
  CHECK_EQ(w.code(Op::latest, "a", "b"), Code::connectivity);
  CHECK(w.set("c", "a", 1));  // what was forgotten closes no cycle
}

TEST_EACH_MODE(many_questions_at_one_instant) {
  World w(c);
  w.set("a", "b", 1, at_x(1));
  w.set("b", "c", 2, at_x(2));
  const std::vector<Query> queries = {w.query(Op::latest_xact, "a", "c"),
                                      w.query(Op::at, "a", "b", 7), w.query(Op::latest, "c", "a"),
                                      w.query(Op::latest_common, "a", "nope")};
  std::vector<Answer> answers(queries.size());
  ReadSet reads;
  w.tree.lookup_transaction(queries, answers, reads);
  CHECK_EQ(answers[0].pose.x, 3);
  CHECK_EQ(answers[1].failure.code, Code::no_data);
  CHECK_EQ(answers[2].pose.x, -3);
  CHECK_EQ(answers[3].failure.code, Code::lookup);
  // The failed one read a link and a root. The link without data at its time is read again, to name
  // the link that is the farthest from that time.
  CHECK_EQ(reads.size(), 7u);
  for (const ReadVersion& read : reads) CHECK_EQ(read.version, w.tree.info(read.frame).version);
}
