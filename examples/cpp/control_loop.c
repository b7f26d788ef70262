/* A control loop at 1 kHz that compares two poses of one instant, and allocates nothing.
 *
 * `control_loop [TREE]` reads the tree of a server on this host; without a tree it makes its own.
 */
#define _POSIX_C_SOURCE 200809L

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "zenoh_tf/zenoh_tf.h"

enum { CYCLES = 1000 };

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static int failed(const char* what, const ztf_error* error) {
  fprintf(stderr, "%s: %s (%s)\n", what, error->message, ztf_code_name(error->code));
  return 1;
}

/* An arm that another thread or process would publish. */
static ztf_code publish(ztf_tree* tree, ztf_error* error) {
  ztf_transform links[2];
  memset(links, 0, sizeof links);
  links[0].parent = links[1].parent = "base";
  links[0].child = "tool";
  links[1].child = "target";
  links[0].stamp_ns = links[1].stamp_ns = now_ns();
  links[0].pose.qw = links[1].pose.qw = 1;
  links[0].pose.x = 0.5;
  links[1].pose.x = 0.75;
  return ztf_set_xact(tree, links, 2, "arm", 0, error);
}

int main(int argc, char** argv) {
  ztf_tree* tree = NULL;
  ztf_error error;
  error.size = sizeof error;
  const int is_own = argc < 2;
  if ((is_own ? ztf_tree_create(NULL, &tree, &error)
              : ztf_tree_open(argv[1], NULL, 5000000000, &tree, &error)) != ZTF_OK)
    return failed("no tree", &error);
  if (is_own && publish(tree, &error) != ZTF_OK) return failed("publish", &error);

  /* The names are looked up once. */
  ztf_frame base[2], moving[2];
  if (ztf_resolve(tree, "base", &base[0], &error) != ZTF_OK ||
      ztf_resolve(tree, "tool", &moving[0], &error) != ZTF_OK ||
      ztf_resolve(tree, "target", &moving[1], &error) != ZTF_OK)
    return failed("resolve", &error);
  base[1] = base[0];

  double distance = 0;
  int misses = 0;
  for (int i = 0; i < CYCLES; ++i) {
    ztf_pose poses[2];
    int64_t stamps_ns[2];
    if (ztf_lookup_xact(tree, ZTF_LATEST_XACT, base, moving, 2, ZTF_NO_STAMP, poses, stamps_ns,
                        NULL) == ZTF_OK)
      distance = sqrt(pow(poses[0].x - poses[1].x, 2) + pow(poses[0].y - poses[1].y, 2) +
                      pow(poses[0].z - poses[1].z, 2));
    else
      ++misses; /* a real loop would hold its last command, and stop after some */
    const struct timespec period = {0, 1000000};
    nanosleep(&period, NULL);
  }
  printf("%d cycles, %d misses, distance %.3f m\n", CYCLES, misses, distance);
  ztf_tree_close(tree);
  return 0;
}
