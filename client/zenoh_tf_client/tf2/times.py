from zenoh_tf.tf2.times import *  # noqa: F403 - the old name of this module
