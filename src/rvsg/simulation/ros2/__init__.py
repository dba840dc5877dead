"""A running ROS 2 navigation system under test, spoken to over DDS. Needs cyclonedds and rosbags (extra `ros2`)."""
