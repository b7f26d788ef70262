#include "hidden_owner.hpp"

#include "owner.hpp"

struct HiddenOwner::Parts {
  ztf::SocketFolder folder;
  ztf::Owner owner{folder, "a1"};
};

HiddenOwner::HiddenOwner() : parts_(std::make_unique<Parts>()) {}
HiddenOwner::~HiddenOwner() = default;
std::string HiddenOwner::folder() const { return parts_->folder.path; }
void HiddenOwner::set_x(const std::string& parent, const std::string& child, std::int64_t stamp,
                        double x) {
  parts_->owner.world.set(parent, child, stamp, ztf::at_x(x));
}
