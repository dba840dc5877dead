"""What is asked of the robot and of the people, as plain data, and the rules that make it valid."""
