from zenoh_tf.tf2.message_filter import *  # noqa: F403 - the old name of this module
