"""Worlds out of other people's files: ROS maps, Moving AI maps and scenarios, the BARN layout."""
