// The Python module `_core`.
#include "bindings/bindings.hpp"

NB_MODULE(_core, m) {
  m.doc() = "The native tree of zenoh-tf; use it through zenoh_tf.";
  // Daemon threads and tracebacks may hold objects at exit; that is no leak to warn a user about.
  nanobind::set_leak_warnings(false);
  ztf::bind_transform(m);
  ztf::bind_stamped(m);
  ztf::bind_estimate_class(m);
  ztf::bind_transform_rows(m);
  ztf::bind_deskew(m);
  ztf::bind_budget(m);
  ztf::bind_operations(m);
  ztf::bind_tree(m);
  ztf::bind_shared_tree(m);
  ztf::bind_parked_lookups(m);
  ztf::bind_change_log(m);
  ztf::bind_change_replay(m);
  ztf::bind_interest_reader(m);
  ztf::bind_join_buffers(m);
  ztf::bind_single_lookup(m);
  ztf::bind_cdr(m);
  ztf::bind_columns(m);
  ztf::bind_texts(m);
}
