"""Import of worlds from ROS maps, Moving AI maps and scenarios, and BARN layouts."""
