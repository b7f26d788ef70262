from zenoh_tf.tf2.messages import *  # noqa: F403 - the old name of this module
