// Reads and writes a tree on behalf of a test: a command on each line of its input, a reply on each
// of its output. Words are separated by spaces. The test sends the program's queries to servers: a
// line "query KEY PAYLOAD TIMEOUT_MS" asks for a line with the reply's payload, both in
// hexadecimal.
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>
#include <sstream>
#include <thread>

#include "zenoh_tf/zenoh_tf.hpp"

namespace {

using zenoh_tf::Answer;
using zenoh_tf::Pose;
using zenoh_tf::Stamp;
using zenoh_tf::Tree;

// A stamp; "-" is none.
Stamp stamp_of(std::istream& words) {
  std::string text;
  words >> text;
  return text == "-" ? zenoh_tf::kNoStamp : std::stoll(text);
}

std::chrono::milliseconds ms_of(std::istream& words) {
  long ms = 0;
  words >> ms;
  return std::chrono::milliseconds(ms);
}

std::string shown(const Answer& answer) {
  const Pose& p = answer.pose;
  std::ostringstream text;
  text.precision(17);
  text << answer.stamp_ns << ' ' << p.x << ' ' << p.y << ' ' << p.z << ' ' << p.qx << ' ' << p.qy
       << ' ' << p.qz << ' ' << p.qw;
  return text.str();
}

// Looks up all the time, and counts. All poses must have x = 0: a torn read has not.
class Watch {
 public:
  Watch(const Tree& tree, const std::string& target, const std::string& source)
      : pair_(tree.pair(target, source)), thread_([this] { run(); }) {}
  ~Watch() {
    done_ = true;
    thread_.join();
  }
  std::atomic<long> answered{0}, unavailable{0}, busy{0}, torn{0}, other{0};

 private:
  void run() {
    Answer answer;
    while (!done_) {
      const ztf_code code = pair_.try_lookup(ZTF_LATEST_XACT, 0, answer);
      if (code == ZTF_OK) {
        ++answered;
        if (std::abs(answer.pose.x) > 1e-6) ++torn;
      } else {
        ++(code == ZTF_SERVER_UNAVAILABLE ? unavailable : code == ZTF_SERVER_BUSY ? busy : other);
      }
    }
  }

  zenoh_tf::Pair pair_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

// Asks the test to send a query.
void query_by_test(void*, const char* key, const void* payload, std::size_t size,
                   std::int64_t timeout_ns, ztf_reply* reply) {
  const auto* const bytes = static_cast<const unsigned char*>(payload);
  std::printf("query %s ", key);
  for (std::size_t i = 0; i < size; ++i) std::printf("%02x", bytes[i]);
  std::printf(" %lld\n", static_cast<long long>(timeout_ns / 1000000 + 1));
  std::fflush(stdout);
  std::string line, out;
  std::getline(std::cin, line);
  for (std::size_t i = 0; i + 1 < line.size(); i += 2)
    out.push_back(static_cast<char>(std::stoi(line.substr(i, 2), nullptr, 16)));
  if (!out.empty()) ztf_reply_set(reply, out.data(), out.size());
}

std::unique_ptr<Tree> tree;
std::unique_ptr<Watch> watch;

std::string run(const std::string& command, std::istream& words) {
  std::string a, b, c;
  std::ostringstream reply;
  if (command == "create") {
    zenoh_tf::Options options;
    options.cache_time_ns = 1000000 * ms_of(words).count();
    tree.reset(new Tree(options));
  } else if (command == "open") {
    words >> a >> b;
    if (b == "default") b.clear();
    tree.reset(new Tree(Tree::open(a, b, ms_of(words))));
  } else if (command == "set") {
    words >> a >> b;
    const Stamp stamp = stamp_of(words);
    bool is_static = false;
    Pose p;
    words >> is_static >> p.x >> p.y >> p.z >> p.qx >> p.qy >> p.qz >> p.qw;
    tree->set(a, b, stamp, p, "", is_static);
  } else if (command == "append") {
    words >> a >> b;
    const Stamp stamp = stamp_of(words);
    double x = 0;
    words >> x;
    reply << tree->link(a, b, "writer").append(stamp, {x, 0, 0, 0, 0, 0, 1});
  } else if (command == "write_through") {
    tree->write_through(query_by_test, nullptr, ms_of(words));
  } else if (command == "set_xact") {  // two links of the same stamp, each with x
    std::string d;
    words >> a >> b >> c >> d;
    const Stamp stamp = stamp_of(words);
    double x = 0, y = 0;
    words >> x >> y;
    tree->set_xact({{a.c_str(), b.c_str(), stamp, {x, 0, 0, 0, 0, 0, 1}},
                    {c.c_str(), d.c_str(), stamp, {y, 0, 0, 0, 0, 0, 1}}},
                   "writer");
  } else if (command == "increment") {  // adds 1 m and 1 ns to the newest pose of b in a
    words >> a >> b;
    int attempts = 0, attempts_max = 1000;
    words >> attempts_max;
    tree->transact(
        [&](zenoh_tf::Transaction& transaction) {
          ++attempts;
          Answer answer;
          try {
            answer = transaction.latest(a, b);
          } catch (const zenoh_tf::LookupException&) {
            answer.pose.qw = 1;
          }
          ++answer.pose.x;
          transaction.set(a, b, answer.stamp_ns + 1, answer.pose);
        },
        "writer", false, attempts_max);
    reply << attempts;
  } else if (command == "clear") {
    tree->clear();
  } else if (command == "remove") {
    words >> a;
    tree->remove_frame(a);
  } else if (command == "lookup") {
    words >> a >> b;
    const Stamp stamp = stamp_of(words);
    return shown(tree->lookup(a, b, stamp, ms_of(words)));
  } else if (command == "full") {
    words >> a;
    const Stamp target_stamp = stamp_of(words);
    words >> b;
    const Stamp source_stamp = stamp_of(words);
    words >> c;
    return shown(tree->lookup_full(a, target_stamp, b, source_stamp, c));
  } else if (command == "server") {
    const ztf_server server = tree->server();
    reply << server.mapped << ' ' << server.instance;
  } else if (command == "watch") {
    words >> a >> b;
    watch.reset(new Watch(*tree, a, b));
  } else if (command == "watched") {
    reply << watch->answered << ' ' << watch->unavailable << ' ' << watch->busy << ' '
          << watch->torn << ' ' << watch->other;
  } else {
    throw std::invalid_argument("unknown command " + command);
  }
  return reply.str();
}

}  // namespace

int main() {
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string command;
    words >> command;
    try {
      const std::string reply = run(command, words);
      std::cout << "ok " << reply << std::endl;
    } catch (const zenoh_tf::TransformException& error) {
      std::cout << ztf_code_name(error.code()) << ' ' << error.what() << std::endl;
    }
  }
  watch.reset();
}
