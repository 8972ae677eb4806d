"""Events in messages and bags of ROS."""
