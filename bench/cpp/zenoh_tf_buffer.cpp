// A tree of this process, or that of a server on the host.
#include "buffer.hpp"
#include "zenoh_tf/zenoh_tf.hpp"

namespace bench {

namespace {

class ZenohTfBuffer final : public Buffer {
 public:
  explicit ZenohTfBuffer(zenoh_tf::Tree tree) : tree_(std::move(tree)) {}

  void write(const Link* links, std::size_t count) override {
    std::vector<ztf_transform> rows;
    for (const Link* link = links; link != links + count; ++link) {
      const auto& [x, y, z, qx, qy, qz, qw] = link->pose;
      rows.push_back({link->parent, link->child, link->stamp, {x, y, z, qx, qy, qz, qw}});
    }
    tree_.set_xact(rows, "arm");
  }

  Stamp lookup(Call call) override {
    if (call == Call::nothing) return 0;
    if (call == Call::names)
      return stamp_of(
          ztf_lookup(tree_.get(), kMap, kTool, ZTF_NO_STAMP, nullptr, &answer_, nullptr));
    if (call == Call::reference)
      return stamp_of(pair_.try_lookup(ZTF_LATEST_COMMON, ZTF_NO_STAMP, answer_));
    ztf_pose poses[2];
    std::int64_t stamps[2];
    const auto code = ztf_lookup_xact(tree_.get(), ZTF_LATEST_COMMON, targets_, sources_, 2,
                                      ZTF_NO_STAMP, poses, stamps, nullptr);
    if (code == ZTF_STALE_FRAME && resolve()) return lookup(call);
    return code == ZTF_OK ? std::min(stamps[0], stamps[1]) : -1;
  }

  Answer tool_at(Stamp stamp) override {
    const zenoh_tf::Answer found = tree_.lookup(kMap, kTool, stamp);
    const auto& [x, y, z, qx, qy, qz, qw] = found.pose;
    return {found.stamp_ns, {x, y, z, qx, qy, qz, qw}};
  }

 private:
  bool resolve() {
    ztf_frame* const frames[] = {&targets_[0], &targets_[1], &sources_[0], &sources_[1]};
    const char* const names[] = {kMap, kMap, kTool, kElbow};
    for (int i = 0; i < 4; ++i)
      if (ztf_resolve(tree_.get(), names[i], frames[i], nullptr) != ZTF_OK) return false;
    return true;
  }
  Stamp stamp_of(ztf_code code) const { return code == ZTF_OK ? answer_.stamp_ns : -1; }

  zenoh_tf::Tree tree_;
  zenoh_tf::Pair pair_ = tree_.pair(kMap, kTool);
  zenoh_tf::Answer answer_;
  ztf_frame targets_[2]{}, sources_[2]{};  // stale at first
};

}  // namespace

std::unique_ptr<Buffer> make_buffer(const std::string& server) {
  if (server.empty()) return std::make_unique<ZenohTfBuffer>(zenoh_tf::Tree());
  return std::make_unique<ZenohTfBuffer>(
      zenoh_tf::Tree::open("main", server, std::chrono::seconds(10)));
}

}  // namespace bench
