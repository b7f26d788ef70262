from zenoh_tf.tf2.buffer_client import *  # noqa: F403 - the old name of this module
