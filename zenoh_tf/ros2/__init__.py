"""ROS 2 over Zenoh, without ROS: messages, keys and liveliness tokens. Server and client share it.

`cdr` has the messages, `keys` the names of topics on the network, `attachment` what publishers send
beside a message, `topics` subscribes, and `publishers` says whose a message is. docs/how-to/ros2.md
is for users.
"""
