// Runs transactions from several threads against one tree and records what each read and wrote, for
// checker.py.
//
// The tree is a trunk of four links with two arms of four on it. A link's translation is its
// version, moved to a place of 13 binary digits that no other link uses: trunk, first and second
// arm have an axis each, and rotations are identities. So the pose of any chain is exact in
// doubles, and says the version of every link on the path. A version is the stamp under which the
// link was written, and every writing transaction has a stamp of its own. The second arm moves
// between the trunk's top and the root: its first link's version says which is its parent. Other
// names come and go (churn.hpp): their links have numbers from kLinks on.
//
// Half of the threads may read elsewhere: in the tree's memory as other processes map it, or in a
// mirror. Or they read and write by the functions of zenoh_tf.h, as programs in C do. What a mirror
// shows may be old, so such a read has no earliest time (history.py), unless a commit has found
// that it was current.
//
// Thread safety: each thread has its own record. The tree and the counter of stamps are shared.
#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "churn.hpp"
#include "links.hpp"
#include "mirror.hpp"
#include "shared/shared_tree.hpp"
#include "tree.hpp"
#ifdef ZTF_WITH_C  // not with faults in the core: each would take twice as long to build
#include "c_api/calls.hpp"
#endif

using namespace ztf;

namespace {

// As in history.py.
enum Outcome : std::int64_t { committed, conflict, late, nonsense, other };
struct Transaction {
  std::int64_t thread, invoked_ns, responded_ns, outcome;
};
// As FROM_A_MIRROR in history.py: invoked_ns of what may be older than the call.
constexpr std::int64_t kFromAMirror = std::numeric_limits<std::int64_t>::min();
struct Access {
  std::int64_t transaction, is_write, link, stamp;
};

[[noreturn]] void fail(const std::string& why) {
  std::fprintf(stderr, "%s\n", why.c_str());
  std::exit(EXIT_FAILURE);
}

// The fences keep the processor from moving timed work across the reading of the clock.
std::int64_t now_ns() {
  std::atomic_thread_fence(std::memory_order_seq_cst);
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  std::atomic_thread_fence(std::memory_order_seq_cst);
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

struct World {
  World(const Options& options) : tree(options) {
    for (int frame = 0; frame <= kLinks; ++frame) names.push_back("frame" + std::to_string(frame));
    commit((1u << kLinks) - 1, 0, {}, {}, false);
    ids = ids_in(tree);
    if (tree.change_log()) {
      mirror = std::make_unique<Mirror>(tree);
      mirror_ids = ids_in(mirror->tree());
    }
    churn.emplace(tree, names[0]);
    if (!options.shared) return;
    tree.begin_lease(3'600'000'000'000);
    mapped = std::make_unique<SharedTree>(tree.descriptor());
  }

  [[nodiscard]] Ids ids_in(const Tree& of) const {
    Ids found;
    for (const std::string& name : names) found.push_back(of.find(name));
    return found;
  }

  // The links in any order.
  std::vector<Row> rows_of(unsigned links, Stamp stamp) {
    written[static_cast<std::size_t>(stamp)] = links;
    std::vector<Row> rows;
    for (int link = 0; link < kLinks; ++link) {
      if (!(links >> link & 1)) continue;
      std::array<double, 3> xyz{};
      xyz[static_cast<std::size_t>(axis_of(link))] =
          std::ldexp(static_cast<double>(stamp), place_of(link));
      rows.push_back({static_cast<std::uint32_t>(parent_of(link, stamp)),
                      static_cast<std::uint32_t>(link + 1),
                      stamp,
                      {xyz[0], xyz[1], xyz[2], 0, 0, 0, 1}});
    }
    if (stamp % 2) std::reverse(rows.begin(), rows.end());
    return rows;
  }

  // `read_ids`: the ids that the read set has. `by_refs`: by references in the place of names.
  Outcome commit(unsigned links, Stamp stamp, const ReadSet* reads, const Ids& read_ids,
                 bool by_refs) {
    std::vector<std::string_view> frames(names.begin(), names.end()), read_names;
    std::vector<Version> read_versions;
    const std::vector<Row> rows = rows_of(links, stamp);
    if (reads)
      for (const ReadVersion& read : *reads) {
        const auto id = std::find(read_ids.begin(), read_ids.end(), read.frame);
        read_names.push_back(names[static_cast<std::size_t>(id - read_ids.begin())]);
        read_versions.push_back(read.version);
      }
    std::vector<std::uint8_t> stored(rows.size());
    std::vector<NameRef> refs;
    if (by_refs) {
      for (const std::string_view name : frames) refs.push_back(tree.find_ref(name));
      frames.clear();
    }
    try {
      tree.commit({.names = frames,
                   .rows = rows,
                   .frames = refs,
                   .read_names = read_names,
                   .read_versions = read_versions},
                  stored);
    } catch (const Rejected& refused) {
      if (refused.code == Code::conflict) return conflict;
      if (by_refs && refused.field == "parent_frame")  // it would give a frame another parent
        return commit(links, stamp, reads, read_ids, false);
      if (refused.code == Code::invalid_argument && refused.field == "stamp_ns") return late;
      fail("refused: " + refused.message);
    }
    return committed;
  }

  Tree tree;
#ifdef ZTF_WITH_C
  // The tree as C has it.
  struct Handle {
    explicit Handle(Tree& tree) { of_c.own.reset(&tree); }
    ~Handle() { (void)of_c.own.release(); }
    Handle(const Handle&) = delete;
    Handle& operator=(const Handle&) = delete;
    ztf_tree of_c;
  } handle{tree};
#endif
  bool uses_c = false;                 // half of the threads
  std::unique_ptr<SharedTree> mapped;  // the tree as other processes see it, if it is shared
  std::atomic<std::int64_t> mapped_reads{0};
  std::unique_ptr<Mirror> mirror;  // if the tree has a change log
  std::vector<std::string> names;
  Ids ids, mirror_ids;
  std::optional<Churn> churn;
  std::atomic<Stamp> clock{1};
  std::atomic<std::int64_t> left;  // transactions still to run
  // By stamp: which links its transaction writes.
  std::array<std::atomic<unsigned>, kLastStamp + 1> written{};
};

class Client {
 public:
  Client(World& world, int thread, unsigned seed)
      : world_(world),
        thread_(thread),
        reads_mirror_(world.mirror && thread % 2 != 0),
        uses_c_(world.uses_c && thread % 2 != 0),
        ids_(reads_mirror_ ? world.mirror_ids : world.ids),
        random_(seed) {}

  void run() {
    while (world_.left.fetch_sub(1) > 0) {
      const unsigned dice = random_() % 100;
      begin();
      has_committed_ = false;
      if (!reads_mirror_ && random_() % 10 < 4) {
        step_churn();
      } else if (uses_c_) {
        if (!step_by_c(dice)) return;
      } else if (dice < 22) {
        if (!write(nullptr)) return;
      } else if (dice < 45) {
        ReadSet reads;
        ask_together({some_pair(Op::latest_xact), some_pair(Op::latest_xact)}, 1 + random_() % 2,
                     reads);
        if (random_() % 4 == 0) std::this_thread::yield();
        if (transactions.back().outcome != nonsense && !write(&reads)) return;
      } else if (dice < 75) {
        ask(some_pair(random_() % 3 ? Op::latest_xact : Op::latest_common));
      } else {
        ReadSet reads;
        ask_together(
            {some_pair(Op::latest_xact), some_pair(Op::latest_common), some_pair(Op::latest_xact)},
            3, reads);
      }
      transactions.back().responded_ns = now_ns();
      if (!reads_mirror_) continue;
      if (has_committed_)
        world_.mirror->wait();  // so the next read shows this commit
      else
        transactions.back().invoked_ns = kFromAMirror;
    }
  }

  std::vector<Transaction> transactions;
  std::vector<Access> accesses;

 private:
  void begin() { transactions.push_back({thread_, now_ns(), 0, committed}); }
  void note(bool is_write, int link, Stamp stamp) {
    accesses.push_back({static_cast<std::int64_t>(transactions.size()) - 1, is_write, link, stamp});
  }

  // Records an answer that contradicts itself.
  void note_nonsense() { transactions.back().outcome = nonsense; }

  Question some_pair(Op op) {
    const int target = static_cast<int>(random_() % (kLinks + 1));
    const int other = static_cast<int>(random_() % kLinks);
    return {ids_, op, target, other + (other >= target)};
  }

  // What a transaction writes; none when the stamps are used up, which ends the history.
  struct Write {
    unsigned links = 0;
    Stamp stamp = 0;
  };
  std::optional<Write> begin_write() {
    Write write{0, world_.clock.fetch_add(1)};
    if (write.stamp > kLastStamp) {
      world_.left = 0;
      transactions.back().responded_ns = now_ns();
      return std::nullopt;
    }
    for (unsigned n = 1 + random_() % 4; n > 0; --n) write.links |= 1u << random_() % kLinks;
    for (int link = 0; link < kLinks; ++link)
      if (write.links >> link & 1) note(true, link, write.stamp);
    return write;
  }

  // Returns false when the stamps are used up.
  bool write(const ReadSet* reads) {
    const std::optional<Write> begun = begin_write();
    if (!begun) return false;
    const Outcome outcome =
        world_.commit(begun->links, begun->stamp, reads, ids_, random_() % 3 == 0);
    transactions.back().outcome = outcome;
    has_committed_ = outcome == committed;
    return true;
  }

#ifndef ZTF_WITH_C
  bool step_by_c(unsigned) { fail("built without the library for C"); }
#else
  // --- by the functions of zenoh_tf.h

  std::vector<ztf_transform> transforms_of(const Write& write) {
    std::vector<ztf_transform> out;
    for (const Row& row : world_.rows_of(write.links, write.stamp))
      out.push_back({name(static_cast<int>(row.parent)), name(static_cast<int>(row.child)),
                     row.stamp, c_api::pose_of(row.pose)});
    return out;
  }
  [[nodiscard]] const char* name(int frame) const {
    return world_.names[static_cast<std::size_t>(frame)].c_str();
  }

  void note_outcome(ztf_code code, const ztf_error& error) {
    const bool is_late =
        code == ZTF_INVALID_ARGUMENT && std::string_view(error.field) == "stamp_ns";
    if (code != ZTF_OK && code != ZTF_CONFLICT && !is_late) fail(error.message);
    transactions.back().outcome = code == ZTF_OK ? committed : is_late ? late : conflict;
  }
  void note_c(const Question& question, ztf_code code, const ztf_answer& found) {
    Answer answer;
    answer.failure.code = static_cast<Code>(code);
    answer.pose = c_api::pose_of(found.pose);
    answer.stamp = found.stamp_ns, answer.newest = found.newest_stamp_ns;
    note_answer(question, answer);
  }

  // One transaction. Returns false when the stamps are used up.
  bool step_by_c(unsigned dice) {
    if (dice < 22) return write_by_c();
    if (dice < 45) return read_and_write_by_c();
    if (dice < 75)
      ask_by_c(some_pair(random_() % 3 ? Op::latest_xact : Op::latest_common));
    else
      ask_together_by_c();
    return true;
  }
  bool write_by_c() {
    const std::optional<Write> begun = begin_write();
    if (!begun) return false;
    const std::vector<ztf_transform> rows = transforms_of(*begun);
    ztf_error error{};
    error.size = sizeof error;
    note_outcome(ztf_set_xact(&world_.handle.of_c, rows.data(), rows.size(), "", 0, &error), error);
    return true;
  }
  bool read_and_write_by_c() {
    ztf_error error{};
    error.size = sizeof error;
    ztf_transaction* begun = nullptr;
    ztf_code code = ztf_transaction_begin(&world_.handle.of_c, &begun, &error);
    const std::unique_ptr<ztf_transaction, void (*)(ztf_transaction*)> transaction(
        begun, ztf_transaction_end);
    for (unsigned n = 1 + random_() % 2; n > 0 && code == ZTF_OK; --n) {
      const Question question = some_pair(Op::latest_xact);
      ztf_answer found{};
      found.size = sizeof found;
      code = ztf_transaction_lookup(begun, ZTF_LATEST_XACT, name(question.target),
                                    name(question.source), 0, &found, &error);
      if (code == ZTF_OK) note_c(question, code, found);
    }
    if (transactions.back().outcome == nonsense) return true;
    if (random_() % 4 == 0) std::this_thread::yield();
    if (code == ZTF_OK) {
      const std::optional<Write> write = begin_write();
      if (!write) return false;
      for (const ztf_transform& row : transforms_of(*write))
        if (code == ZTF_OK) code = ztf_transaction_set(begun, &row, &error);
      if (code == ZTF_OK) code = ztf_transaction_commit(begun, "", 0, &error);
    }
    note_outcome(code, error);
    return true;
  }
  void ask_by_c(const Question& question) {
    ztf_answer found{};
    found.size = sizeof found;
    const char *const target = name(question.target), *const source = name(question.source);
    const ztf_code code =
        question.query.op == Op::latest_xact
            ? ztf_latest_xact(&world_.handle.of_c, target, source, &found, nullptr)
            : ztf_lookup(&world_.handle.of_c, target, source, ZTF_NO_STAMP, nullptr, &found,
                         nullptr);
    note_c(question, code, found);
  }
  void ask_together_by_c() {
    constexpr std::size_t kPairs = 3;
    std::vector<Question> questions;
    ztf_frame targets[kPairs], sources[kPairs];
    ztf_pose poses[kPairs];
    std::int64_t stamps[kPairs];
    for (std::size_t i = 0; i < kPairs; ++i) {
      questions.push_back(some_pair(Op::latest_xact));
      if (ztf_resolve(&world_.handle.of_c, name(questions[i].target), &targets[i], nullptr) !=
              ZTF_OK ||
          ztf_resolve(&world_.handle.of_c, name(questions[i].source), &sources[i], nullptr) !=
              ZTF_OK)
        fail("a frame is not there");
    }
    const ztf_code code = ztf_lookup_xact(&world_.handle.of_c, ZTF_LATEST_XACT, targets, sources,
                                          kPairs, 0, poses, stamps, nullptr);
    for (std::size_t i = 0; i < kPairs; ++i)
      note_c(questions[i], code, {0, poses[i], stamps[i], kNoStamp, 0});
  }
#endif

  // Calls read(tree). Threads that read as another process does ask the tree itself where that
  // gives no answer.
  template <class Read>
  void read(Read&& read) {
    if (reads_mirror_) return read(world_.mirror->tree());
    if (world_.mapped && thread_ % 2 != 0) {
      try {
        read(*world_.mapped);
        ++world_.mapped_reads;
        return;
      } catch (const Unanswered& why) {
        if (why.reason != Unanswered::Reason::busy) fail("a mapped tree cannot be read");
      }
    }
    read(world_.tree);
  }

  void step_churn() {
    const Churn::Result result = world_.churn->step(random_);
    for (const Churn::Access& access : result.accesses)
      note(access.is_write, kLinks + access.name, access.stamp);
    if (result.is_nonsense)
      note_nonsense();
    else if (result.rejected)
      transactions.back().outcome = *result.rejected == Code::conflict ? conflict : other;
  }

  void ask(const Question& question) {
    Answer answer;
    read([&](const auto& tree) { tree.lookup(question.query, answer); });
    note_answer(question, answer);
  }
  void ask_together(const std::vector<Question>& questions, std::size_t n, ReadSet& reads) {
    std::vector<Query> queries;
    for (std::size_t i = 0; i < n; ++i) queries.push_back(questions[i].query);
    std::vector<Answer> answers(n);
    read([&](const auto& tree) { tree.lookup_transaction(queries, answers, reads); });
    for (std::size_t i = 0; i < n; ++i) note_answer(questions[i], answers[i]);
  }

  void note_answer(const Question& question, const Answer& answer) {
    const Code code = answer.failure.code;
    if (question.query.op == Op::latest_xact) {
      if (code != Code::ok) fail("a latest lookup has failed");
      return note_versions(question, answer);
    }
    if (code == Code::ok) return note_common(question, answer.stamp);
    // The links' histories may have no time in common.
    if (code != Code::extrapolation && code != Code::no_data && code != Code::backward &&
        code != Code::forward)
      fail("a common lookup has failed");
  }

  void note_versions(const Question& question, const Answer& answer) {
    // The arm's parent does not matter for the links of the arm itself.
    const std::array<double, 3> sums{answer.pose.x, answer.pose.y, answer.pose.z};
    const auto version = [&](int link, const Between& links) {
      const int axis = axis_of(link);
      const double sum =
          (links.up >> (4 * axis) & 0xF ? -1 : 1) * sums[static_cast<std::size_t>(axis)];
      if (!(sum >= 0 && sum < 0x1p52 && sum == std::floor(sum))) return kNoStamp;
      return static_cast<Stamp>(sum) >> place_of(link) & kLastStamp;
    };
    const Between links = question.links(version(kMovingLink, question.links(0)));
    Stamp oldest = kLastStamp, newest = 0;
    for (int link = 0; link < kLinks; ++link) {
      const Stamp stamp = version(link, links);
      if (stamp == kNoStamp) return note_nonsense();
      if (links.all() >> link & 1) {
        note(false, link, stamp);
        oldest = std::min(oldest, stamp);
        newest = std::max(newest, stamp);
      } else if (stamp != 0) {
        return note_nonsense();  // a link that is not on the path
      }
    }
    const bool has_newest = answer.newest != kNoStamp;  // not of ztf_lookup_xact()
    if (oldest != answer.stamp || (has_newest && newest != answer.newest)) note_nonsense();
  }

  // The pose may be interpolated, but the time is the newest stamp of at least one of the links. It
  // is certain of which one if that stamp's transaction wrote only one of them, whatever the arm's
  // parent.
  void note_common(const Question& question, Stamp stamp) {
    const unsigned links = (question.links(0).all() | question.links(4).all()) &
                           world_.written[static_cast<std::size_t>(stamp)];
    if (links == 0) return note_nonsense();  // a time that none of the links has
    if (std::has_single_bit(links)) note(false, std::countr_zero(links), stamp);
  }

  World& world_;
  const int thread_;
  const bool reads_mirror_, uses_c_;
  const Ids& ids_;              // of the tree that is read
  bool has_committed_ = false;  // in this transaction
  std::mt19937 random_;
};

template <class T>
void put(std::FILE* file, const T* values, std::size_t n) {
  if (std::fwrite(values, sizeof(T), n, file) != n) fail("cannot write");
}

}  // namespace

// driver MODE CACHE_NS SEED THREADS TRANSACTIONS READS FILE
int main(int argc, char** argv) {
  if (argc != 8) fail("usage: driver MODE CACHE_NS SEED THREADS TRANSACTIONS READS FILE");
  const std::string mode = argv[1];
  // Names have no room all at a time, so that ids pass on often, and some commits are rejected.
  Options options{.cache_ns = std::stoull(argv[2]),
                  .max_frames = kLinks + 1 + 3 * Churn::kNames / 2};
  const std::string reads = argv[6];
  options.shared = reads == "shared";
  if (reads == "mirror") options.max_log_bytes = 64 << 20;
  if (mode == "optimistic")
    options.concurrency = Concurrency::optimistic;
  else if (mode == "2pl")
    options.concurrency = Concurrency::two_phase;
  else if (mode == "giant")
    options.concurrency = Concurrency::giant;
  else
    fail("no such mode: " + mode);
  const auto seed = static_cast<unsigned>(std::stoul(argv[3]));
#ifdef ZTF_YIELDS
  yield_seed = seed;
#endif
  const int threads = std::stoi(argv[4]);
  World world(options);
  world.uses_c = reads == "c";
  world.left = std::stoll(argv[5]);

  std::vector<Client> clients;
  for (int i = 0; i < threads; ++i)
    clients.emplace_back(world, i, seed * 1000 + static_cast<unsigned>(i));
  std::vector<std::thread> running;
  for (Client& client : clients) running.emplace_back([&client] { client.run(); });
  for (std::thread& thread : running) thread.join();
  if (world.mapped && world.mapped_reads == 0) fail("no read was answered by the mapped tree");

  std::int64_t sizes[2] = {0, 0};
  for (Client& client : clients) {
    for (Access& access : client.accesses) access.transaction += sizes[0];
    sizes[0] += static_cast<std::int64_t>(client.transactions.size());
    sizes[1] += static_cast<std::int64_t>(client.accesses.size());
  }
  std::FILE* const file = std::fopen(argv[7], "wb");
  if (!file) fail("cannot open the file");
  put(file, sizes, 2);
  for (const Client& client : clients)
    put(file, client.transactions.data(), client.transactions.size());
  for (const Client& client : clients) put(file, client.accesses.data(), client.accesses.size());
  if (std::fclose(file) != 0) fail("cannot write");
  return EXIT_SUCCESS;
}
