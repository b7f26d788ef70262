// An Owner with a folder of its own, for tests in a C++ before 20.
//
// Thread safety: the owner's.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

class HiddenOwner {
 public:
  HiddenOwner();
  ~HiddenOwner();
  std::string folder() const;
  void set_x(const std::string& parent, const std::string& child, std::int64_t stamp, double x);

 private:
  struct Parts;
  const std::unique_ptr<Parts> parts_;
};
