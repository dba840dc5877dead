"""A ROS 2 navigation under test with RVSG, over any middleware."""
