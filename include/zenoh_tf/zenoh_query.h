/* Sends the writes to a server's tree over a session of zenoh-c (zenoh.h) or zenoh-pico
 * (zenoh-pico.h), whichever the caller has included before; from version 1.0 on. It is
 * tested with zenoh-pico only.
 *
 *   ztf_write_through(tree, ztf_zenoh_query, (void*)z_loan(session), 1000000000, &error);
 *
 * The session must be able to reach the server, and outlive the tree. With zenoh-pico, its read
 * task must run (zp_start_read_task()).
 */
#ifndef ZENOH_TF_ZENOH_QUERY_H
#define ZENOH_TF_ZENOH_QUERY_H

#include "zenoh_tf.h"

/* A ztf_query_fn. `context` is a const z_loaned_session_t*. */
static inline void ztf_zenoh_query(void* context, const char* key, const void* payload, size_t size,
                                   int64_t timeout_ns, ztf_reply* reply) {
  const z_loaned_session_t* session = (const z_loaned_session_t*)context;
  z_view_keyexpr_t expression;
  z_owned_closure_reply_t send;
  z_owned_fifo_handler_reply_t replies;
  z_owned_bytes_t body;
  z_owned_reply_t received;
  z_get_options_t options;

  if (z_view_keyexpr_from_str(&expression, key) != 0) return;
  if (z_bytes_copy_from_buf(&body, (const uint8_t*)payload, size) != 0) return;
  if (z_fifo_channel_reply_new(&send, &replies, 1) != 0) {
    z_bytes_drop(z_bytes_move(&body));
    return;
  }
  z_get_options_default(&options);
  options.payload = z_bytes_move(&body);
  options.timeout_ms = (uint64_t)(timeout_ns / 1000000 + 1);
  if (z_get(session, z_view_keyexpr_loan(&expression), "", z_closure_reply_move(&send), &options) ==
          0 &&
      z_fifo_handler_reply_recv(z_fifo_handler_reply_loan(&replies), &received) == 0) {
    const z_loaned_reply_t* got = z_reply_loan(&received);
    const z_loaned_bytes_t* bytes = z_reply_is_ok(got) ? z_sample_payload(z_reply_ok(got))
                                                       : z_reply_err_payload(z_reply_err(got));
    z_owned_slice_t slice;
    if (z_bytes_to_slice(bytes, &slice) == 0) {
      ztf_reply_set(reply, z_slice_data(z_slice_loan(&slice)), z_slice_len(z_slice_loan(&slice)));
      z_slice_drop(z_slice_move(&slice));
    }
    z_reply_drop(z_reply_move(&received));
  }
  z_fifo_handler_reply_drop(z_fifo_handler_reply_move(&replies));
}

#endif
