// The transform tree for C++11 and later: zenoh_tf.h with classes and exceptions, and nothing else.
//
// zenoh_tf.h has the meaning of each function: units, the direction of frames, errors, what
// allocates or blocks, thread safety. A class here adds nothing to that but what its comment says.
#pragma once

#include <algorithm>
#include <chrono>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "zenoh_tf/zenoh_tf.h"

namespace zenoh_tf {

using Pose = ztf_pose;
using Stamp = std::int64_t;  // nanoseconds
constexpr Stamp kNoStamp = ZTF_NO_STAMP;

// A name as an argument, without a copy. The text must end with a zero byte.
class Name {
 public:
  Name(const char* text) noexcept : text_(text) {}
  Name(const std::string& text) noexcept : text_(text.c_str()) {}
  operator const char*() const noexcept { return text_; }

 private:
  const char* text_;
};

// Every error, with its facts. Programs mostly catch one of the classes below.
class TransformException : public std::runtime_error {
 public:
  explicit TransformException(const ztf_error& facts)
      : std::runtime_error(facts.message), facts_(facts) {}
  ztf_code code() const noexcept { return static_cast<ztf_code>(facts_.code); }
  const ztf_error& facts() const noexcept { return facts_; }

 private:
  ztf_error facts_;
};
struct LookupException : TransformException {
  using TransformException::TransformException;
};
struct ConnectivityException : TransformException {
  using TransformException::TransformException;
};
struct InvalidArgumentException : TransformException {
  using TransformException::TransformException;
};
// Also of its kinds: ZTF_NO_DATA, ZTF_BACKWARD, ZTF_FORWARD and ZTF_GAP.
struct ExtrapolationException : TransformException {
  using TransformException::TransformException;
};
// What a transaction has read was changed by others again and again.
struct ConflictException : TransformException {
  using TransformException::TransformException;
};
// ZTF_SERVER_UNAVAILABLE, ZTF_SERVER_BUSY, ZTF_SERVER_RESTARTED and ZTF_TIMEOUT: nothing was done,
// and the same call may succeed later.
struct ServerException : TransformException {
  using TransformException::TransformException;
};

namespace detail {

// Whether a transaction failed for the writes of others, so that another attempt may succeed.
inline bool disturbed(ztf_code code) noexcept {
  return code == ZTF_CONFLICT || code == ZTF_SERVER_BUSY;
}

[[noreturn]] inline void raise(const ztf_error& error) {
  switch (error.code) {
    case ZTF_LOOKUP:
    case ZTF_SERVER_STARTING:
      throw LookupException(error);
    case ZTF_CONNECTIVITY:
      throw ConnectivityException(error);
    case ZTF_INVALID_ARGUMENT:
      throw InvalidArgumentException(error);
    case ZTF_EXTRAPOLATION:
    case ZTF_NO_DATA:
    case ZTF_BACKWARD:
    case ZTF_FORWARD:
    case ZTF_GAP:
      throw ExtrapolationException(error);
    case ZTF_CONFLICT:
      throw ConflictException(error);
    case ZTF_SERVER_UNAVAILABLE:
    case ZTF_SERVER_BUSY:
    case ZTF_SERVER_RESTARTED:
    case ZTF_TIMEOUT:
      throw ServerException(error);
    default:
      throw TransformException(error);
  }
}

// Calls function(&error), and throws the error that it returns. Only its size is set before: to
// clear all of it would take as long as a lookup.
template <class Function>
void check(Function&& function) {
  ztf_error error;
  error.size = sizeof error;
  if (function(&error) != ZTF_OK) raise(error);
}

// Pauses so long at most, after a conflict: writers that pause alike would meet again.
inline void pause(int longest_us) {
  thread_local std::minstd_rand random(std::random_device{}());
  std::uniform_int_distribution<int> pause_us(0, longest_us);
  std::this_thread::sleep_for(std::chrono::microseconds(pause_us(random)));
}

// The names that call(buffer, size, &needed, &error) writes. They may change between two calls.
template <class Call>
std::vector<std::string> names(Call&& call) {
  std::string buffer(1024, '\0');
  for (;;) {
    std::size_t needed = 0;
    ztf_error error;
    error.size = sizeof error;
    const ztf_code code = call(&buffer[0], buffer.size(), &needed, &error);
    if (code == ZTF_BUFFER_TOO_SMALL) {
      buffer.resize(2 * needed);
      continue;
    }
    if (code != ZTF_OK) raise(error);
    std::vector<std::string> names;
    for (const char* name = buffer.data(); name != buffer.data() + needed;) {
      names.emplace_back(name);
      name += names.back().size() + 1;
    }
    return names;
  }
}

}  // namespace detail

// What a lookup has found: X_target_source and its stamps.
struct Answer : ztf_answer {
  Answer() noexcept : ztf_answer() { size = sizeof(ztf_answer); }
};

// How a lookup waits, and over which gaps it interpolates.
struct LookupOptions : ztf_lookup_options {
  LookupOptions() noexcept : ztf_lookup_options(ZTF_LOOKUP_INIT) {}
  template <class Number, class Unit>
  LookupOptions(std::chrono::duration<Number, Unit> timeout) : LookupOptions() {
    timeout_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(timeout).count();
  }
};

struct Options : ztf_options {
  Options() noexcept : ztf_options(ZTF_OPTIONS_INIT) {}
};

class Tree;

// Two frames of a tree that are looked up again and again, without their names. A pair whose frames
// get stale finds its names again, so it outlives removals and restarts of a server. It must not
// outlive the tree. For one thread at a time.
class Pair {
 public:
  Answer lookup(Stamp stamp = kNoStamp) {
    return run(stamp == kNoStamp ? ZTF_LATEST_COMMON : ZTF_AT, stamp);
  }
  Answer latest() { return run(ZTF_LATEST, kNoStamp); }
  Answer latest_xact() { return run(ZTF_LATEST_XACT, kNoStamp); }
  // The poses at many times. A row that fails has its code in `codes`.
  void lookup(const std::vector<Stamp>& stamps, std::vector<Pose>& poses,
              std::vector<std::int32_t>& codes) {
    poses.resize(stamps.size());
    codes.resize(stamps.size());
    follow([&](ztf_error* error) {
      return ztf_lookup_times(tree_, &target_, &source_, stamps.data(), stamps.size(), poses.data(),
                              codes.data(), error);
    });
  }
  // The same as lookup(), latest() and latest_xact() without exceptions, for control loops.
  ztf_code try_lookup(ztf_op op, Stamp stamp, Answer& answer) noexcept {
    const ztf_code code = ztf_lookup_ref(tree_, op, &target_, &source_, stamp, &answer, nullptr);
    if (code != ZTF_STALE_FRAME) return code;
    const ztf_code found = resolve(nullptr);
    if (found != ZTF_OK) return found;
    return ztf_lookup_ref(tree_, op, &target_, &source_, stamp, &answer, nullptr);
  }

 private:
  friend class Tree;
  friend class Link;
  Pair(const ztf_tree* tree, std::string target, std::string source)
      : tree_(tree), target_name_(std::move(target)), source_name_(std::move(source)) {}

  ztf_code resolve(ztf_error* error) noexcept {
    const ztf_code code = ztf_resolve(tree_, target_name_.c_str(), &target_, error);
    return code != ZTF_OK ? code : ztf_resolve(tree_, source_name_.c_str(), &source_, error);
  }
  template <class Call>
  void follow(Call&& call) {
    ztf_error error;
    error.size = sizeof error;
    for (;;) {
      ztf_code code = call(&error);
      if (code == ZTF_STALE_FRAME)
        code = resolve(&error);
      else if (code == ZTF_OK)
        return;
      if (code != ZTF_OK) detail::raise(error);
    }
  }
  Answer run(ztf_op op, Stamp stamp) {
    Answer answer;
    follow([&](ztf_error* error) {
      return ztf_lookup_ref(tree_, op, &target_, &source_, stamp, &answer, error);
    });
    return answer;
  }

  const ztf_tree* tree_;
  std::string target_name_, source_name_;
  ztf_frame target_ = ztf_frame(), source_ = ztf_frame();  // stale at first
};

// A link that this program appends to, without its names: a pair, whose target is the parent. Once
// the link was set, and unless its frames were removed, append() finds them.
class Link : public Pair {
 public:
  // Returns false if the transform is too old to be stored.
  bool append(Stamp stamp, const Pose& pose) {
    std::size_t stored = 0;
    follow([&](ztf_error* error) {
      return ztf_append(written_, &target_, &source_, &stamp, &pose, 1, authority_.c_str(), &stored,
                        error);
    });
    return stored != 0;
  }

 private:
  friend class Tree;
  Link(ztf_tree* tree, std::string parent, std::string child, std::string authority)
      : Pair(tree, std::move(parent), std::move(child)),
        written_(tree),
        authority_(std::move(authority)) {}

  ztf_tree* written_;
  std::string authority_;
};

// What a transaction looks up and sets, see Tree::transact().
class Transaction {
 public:
  Answer lookup(Name target, Name source, Stamp stamp = kNoStamp) {
    return run(stamp == kNoStamp ? ZTF_LATEST_COMMON : ZTF_AT, target, source, stamp);
  }
  // The newest sample of every link, all read at one instant.
  Answer latest(Name target, Name source) { return run(ZTF_LATEST_XACT, target, source, kNoStamp); }
  // Is stored if the transaction is committed. It cannot be looked up in the same one.
  void set(Name parent, Name child, Stamp stamp, const Pose& pose) {
    const ztf_transform transform = {parent, child, stamp, pose};
    detail::check([&](ztf_error* error) {
      return ztf_transaction_set(transaction_.get(), &transform, error);
    });
  }

 private:
  friend class Tree;
  explicit Transaction(ztf_tree* tree) : transaction_(nullptr, ztf_transaction_end) {
    ztf_transaction* begun = nullptr;
    detail::check([&](ztf_error* error) { return ztf_transaction_begin(tree, &begun, error); });
    transaction_.reset(begun);
  }
  Answer run(ztf_op op, const char* target, const char* source, Stamp stamp) {
    Answer answer;
    detail::check([&](ztf_error* error) {
      return ztf_transaction_lookup(transaction_.get(), op, target, source, stamp, &answer, error);
    });
    return answer;
  }

  std::unique_ptr<ztf_transaction, void (*)(ztf_transaction*)> transaction_;
};

// A tree of this process, or a server's.
class Tree {
 public:
  explicit Tree(const Options& options = Options()) {
    detail::check([&](ztf_error* error) { return ztf_tree_create(&options, &tree_, error); });
  }
  // The tree of a server on this host; an empty folder is the default one.
  static Tree open(Name name = "main", const std::string& folder = std::string(),
                   std::chrono::nanoseconds timeout = std::chrono::nanoseconds(0)) {
    ztf_tree* tree = nullptr;
    detail::check([&](ztf_error* error) {
      return ztf_tree_open(name, folder.empty() ? nullptr : folder.c_str(), timeout.count(), &tree,
                           error);
    });
    return Tree(tree);
  }
  ~Tree() { ztf_tree_close(tree_); }
  Tree(Tree&& other) noexcept : tree_(other.tree_) { other.tree_ = nullptr; }
  Tree& operator=(Tree&& other) noexcept {
    std::swap(tree_, other.tree_);
    return *this;
  }
  Tree(const Tree&) = delete;
  Tree& operator=(const Tree&) = delete;

  // For functions of zenoh_tf.h. It stays this object's.
  ztf_tree* get() const noexcept { return tree_; }

  ztf_server server() const {
    ztf_server state;
    state.size = sizeof state;
    detail::check([&](ztf_error* error) { return ztf_server_state(tree_, &state, error); });
    return state;
  }

  // Returns false if the transform is too old to be stored.
  bool set(Name parent, Name child, Stamp stamp, const Pose& pose, Name authority = "",
           bool is_static = false) {
    const ztf_transform transform = {parent, child, stamp, pose};
    std::int32_t stored = 0;
    detail::check([&](ztf_error* error) {
      return ztf_set(tree_, &transform, authority, is_static ? ZTF_STATIC : 0, &stored, error);
    });
    return stored != 0;
  }
  void set_xact(const std::vector<ztf_transform>& transforms, Name authority = "",
                bool is_static = false) {
    detail::check([&](ztf_error* error) {
      return ztf_set_xact(tree_, transforms.data(), transforms.size(), authority,
                          is_static ? ZTF_STATIC : 0, error);
    });
  }
  void clear(bool keep_static = true) {
    detail::check([&](ztf_error* error) { return ztf_clear(tree_, keep_static, error); });
  }
  void remove_frame(Name frame, bool subtree = false) {
    detail::check([&](ztf_error* error) { return ztf_remove_frame(tree_, frame, subtree, error); });
  }

  // Lets a server's tree be written to, see ztf_write_through().
  void write_through(ztf_query_fn query, void* context, std::chrono::nanoseconds timeout) {
    detail::check([&](ztf_error* error) {
      return ztf_write_through(tree_, query, context, timeout.count(), error);
    });
  }
  // Runs body(transaction), and then stores what it has set, if all that it has looked up still
  // holds. Else, or if others wrote while it read (ZTF_SERVER_BUSY), it does so again, up to
  // `attempts` times in all, and then throws the last ConflictException or ServerException. Any
  // other exception of the body ends the transaction without storing anything.
  template <class Body>
  void transact(Body&& body, Name authority = "", bool is_static = false, int attempts = 10) {
    for (int pause_us = 1;; pause_us = std::min(2 * pause_us, 10000)) {
      Transaction transaction(tree_);
      ztf_error error;
      error.size = sizeof error;
      try {
        body(transaction);
      } catch (const TransformException& failed) {
        if (!detail::disturbed(failed.code()) || --attempts <= 0) throw;
        detail::pause(pause_us);
        continue;
      }
      const ztf_code code = ztf_transaction_commit(transaction.transaction_.get(), authority,
                                                   is_static ? ZTF_STATIC : 0, &error);
      if (code == ZTF_OK) return;
      if (!detail::disturbed(code) || --attempts <= 0) detail::raise(error);
      detail::pause(pause_us);
    }
  }

  Answer lookup(Name target, Name source, Stamp stamp = kNoStamp,
                const LookupOptions& options = LookupOptions()) const {
    Answer answer;
    detail::check([&](ztf_error* error) {
      return ztf_lookup(tree_, target, source, stamp, &options, &answer, error);
    });
    return answer;
  }
  Answer lookup_full(Name target, Stamp target_stamp, Name source, Stamp source_stamp, Name fixed,
                     const LookupOptions& options = LookupOptions()) const {
    Answer answer;
    detail::check([&](ztf_error* error) {
      return ztf_lookup_full(tree_, target, target_stamp, source, source_stamp, fixed, &options,
                             &answer, error);
    });
    return answer;
  }
  bool can(Name target, Name source, Stamp stamp = kNoStamp,
           const LookupOptions& options = LookupOptions()) const noexcept {
    return ztf_can(tree_, target, source, stamp, &options) != 0;
  }
  Answer latest(Name target, Name source) const {
    Answer answer;
    detail::check(
        [&](ztf_error* error) { return ztf_latest(tree_, target, source, &answer, error); });
    return answer;
  }
  Answer latest_xact(Name target, Name source) const {
    Answer answer;
    detail::check(
        [&](ztf_error* error) { return ztf_latest_xact(tree_, target, source, &answer, error); });
    return answer;
  }
  Stamp common_time(Name target, Name source) const {
    Stamp stamp = kNoStamp;
    detail::check(
        [&](ztf_error* error) { return ztf_common_time(tree_, target, source, &stamp, error); });
    return stamp;
  }
  // Needs no frame of these names yet.
  Pair pair(std::string target, std::string source) const {
    return Pair(tree_, std::move(target), std::move(source));
  }

  Link link(std::string parent, std::string child, std::string authority = std::string()) {
    return Link(tree_, std::move(parent), std::move(child), std::move(authority));
  }

  std::vector<std::string> frames() const {
    return detail::names(
        [&](char* buffer, std::size_t size, std::size_t* needed, ztf_error* error) {
          return ztf_frames(tree_, buffer, size, needed, error);
        });
  }
  // Empty for a root.
  std::string parent(Name frame, Stamp stamp = kNoStamp) const {
    const std::vector<std::string> found =
        detail::names([&](char* buffer, std::size_t size, std::size_t* needed, ztf_error* error) {
          return ztf_parent(tree_, frame, stamp, buffer, size, needed, error);
        });
    return found.empty() ? std::string() : found[0];
  }
  std::vector<std::string> chain(Name target, Name source, Stamp stamp = kNoStamp) const {
    return detail::names(
        [&](char* buffer, std::size_t size, std::size_t* needed, ztf_error* error) {
          return ztf_chain(tree_, target, source, stamp, buffer, size, needed, error);
        });
  }
  ztf_frame_info info(Name frame) const {
    ztf_frame_info info;
    info.size = sizeof info;
    detail::check([&](ztf_error* error) { return ztf_info(tree_, frame, &info, error); });
    return info;
  }

 private:
  explicit Tree(ztf_tree* tree) noexcept : tree_(tree) {}

  ztf_tree* tree_ = nullptr;
};

}  // namespace zenoh_tf
