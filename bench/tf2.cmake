# Finds the real tf2, which is optional (Debian: libtf2-dev and libboost-thread-dev): sets
# TF2_INCLUDE, and makes the target bench_tf2.
find_path(TF2_INCLUDE tf2/buffer_core.h PATHS /opt/ros/noetic/include)
if(TF2_INCLUDE)
  add_library(bench_tf2 INTERFACE)
  target_include_directories(bench_tf2 SYSTEM INTERFACE ${TF2_INCLUDE})
  target_link_directories(bench_tf2 INTERFACE ${TF2_INCLUDE}/../lib)
  target_link_libraries(bench_tf2 INTERFACE tf2 console_bridge rostime boost_system boost_thread)
endif()
