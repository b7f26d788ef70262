from zenoh_tf.tf2.transform_listener import *  # noqa: F403 - the old name of this module
