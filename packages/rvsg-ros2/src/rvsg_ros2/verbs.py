"""Verbs that this distribution adds to the command line."""

from rvsg.cli.frame import CONNECT, Verb

VERBS = {
    "ros2": Verb("rvsg_ros2.verb", "Check a ROS 2 navigation, write Nav2 parameters", CONNECT),
}
