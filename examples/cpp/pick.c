/* Lets a gripper take an object: reads where the object is, and makes it the gripper's child at the
 * same place, in one transaction. It writes to the server's tree over zenoh-pico.
 *
 *   pick ENDPOINT [FOLDER]    for example: pick tcp/127.0.0.1:7447
 *
 * ENDPOINT is where the server listens, FOLDER its --share-dir.
 */
#include <stdio.h>
#include <time.h>
#include <zenoh-pico.h>
#include <zenoh_tf/zenoh_query.h>
#include <zenoh_tf/zenoh_tf.h>

/* One attempt. */
static ztf_code pick(ztf_transaction* transaction, int64_t stamp_ns, ztf_error* error) {
  ztf_answer grip; /* X_gripper_object */
  grip.size = sizeof grip;
  ztf_code code =
      ztf_transaction_lookup(transaction, ZTF_LATEST_XACT, "gripper", "object", 0, &grip, error);
  if (code != ZTF_OK) return code;
  const ztf_transform held = {"gripper", "object", stamp_ns, grip.pose};
  code = ztf_transaction_set(transaction, &held, error);
  return code != ZTF_OK ? code : ztf_transaction_commit(transaction, "picker", 0, error);
}

static int run(z_owned_session_t* session, const char* folder) {
  ztf_error error;
  ztf_tree* tree = NULL;
  ztf_transaction* transaction = NULL;
  error.size = sizeof error;
  ztf_code code = ztf_tree_open("main", folder, 5000000000, &tree, &error);
  if (code == ZTF_OK)
    code = ztf_write_through(tree, ztf_zenoh_query, (void*)z_session_loan(session), 1000000000,
                             &error);
  if (code == ZTF_OK) code = ztf_transaction_begin(tree, &transaction, &error);
  if (code == ZTF_OK) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    const int64_t stamp_ns = now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
    int attempts = 10;
    do {
      code = pick(transaction, stamp_ns, &error); /* ZTF_CONFLICT: what it has read was changed */
    } while ((code == ZTF_CONFLICT || code == ZTF_SERVER_BUSY) && --attempts > 0);
  }
  if (code == ZTF_OK)
    puts("the gripper holds the object");
  else
    fprintf(stderr, "%s: %s\n", ztf_code_name(code), error.message);
  ztf_transaction_end(transaction);
  ztf_tree_close(tree);
  return code == ZTF_OK ? 0 : 1;
}

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    fputs("usage: pick ENDPOINT [FOLDER]\n", stderr);
    return 2;
  }
  z_owned_config_t config;
  z_owned_session_t session;
  z_config_default(&config);
  zp_config_insert(z_config_loan_mut(&config), Z_CONFIG_MODE_KEY, "client");
  zp_config_insert(z_config_loan_mut(&config), Z_CONFIG_CONNECT_KEY, argv[1]);
  if (z_open(&session, z_config_move(&config), NULL) < 0) {
    fprintf(stderr, "nothing listens on %s\n", argv[1]);
    return 1;
  }
  zp_start_read_task(z_session_loan_mut(&session), NULL);
  zp_start_lease_task(z_session_loan_mut(&session), NULL);
  const int status = run(&session, argc == 3 ? argv[2] : NULL);
  z_session_drop(z_session_move(&session));
  return status;
}
