from zenoh_tf.tf2.future import *  # noqa: F403 - the old name of this module
