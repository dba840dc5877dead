"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import Verb

VERBS = {
    "ros2": Verb("rvsg_ros2.verb", "Check a running ROS 2 navigation, or scale Nav2's parameters for a faster clock"),
}
