#!/bin/bash
# The rows that only a real rmw_zenoh can judge, by the ros2 command line; see docs/reference/ros2-rows.md.
# `real_ros.sh` expects ROS in this shell, and a robot started with `sidestep up --no-goal --ros2`.
# `real_ros.sh container` is for a container of ROS with this checkout in /sidestep.
set -uo pipefail
export RMW_IMPLEMENTATION=rmw_zenoh_cpp ROBOT=${ROBOT:-/r1}
failed=0

# step NAME PATTERN COMMAND...: the command must print the pattern within half a minute.
step() {
	local name=$1 pattern=$2 output
	shift 2
	output=$(timeout 30 "$@" 2>&1)
	if grep -qE -- "$pattern" <<<"$output"; then
		echo "pass  $name"
	else
		failed=1
		printf 'FAIL  %s: no %s in\n%s\n' "$name" "$pattern" "$output"
	fi
}

in_container() {
	set -e
	apt-get update -qq
	apt-get install -qq -y --no-install-recommends python3-venv python3-pip \
		"ros-$ROS_DISTRO-rmw-zenoh-cpp" "ros-$ROS_DISTRO-nav2-msgs" \
		"ros-$ROS_DISTRO-rosbag2-storage-mcap" "ros-$ROS_DISTRO-tf2-ros" "ros-$ROS_DISTRO-ros2bag"
	# ROS puts its packages on PYTHONPATH, which those of this checkout must not see.
	env -u PYTHONPATH python3 -m venv /venv
	env -u PYTHONPATH /venv/bin/pip install -q "/sidestep[ros2]"
	set +u
	. "/opt/ros/$ROS_DISTRO/setup.bash"
	set -u
	ros2 run rmw_zenoh_cpp rmw_zenohd >/tmp/router.log 2>&1 &
	env -u PYTHONPATH /venv/bin/sidestep up --world forest_dense --no-goal --headless --ros2 \
		>/tmp/up.log 2>&1 &
	set +e
}

[ "${1:-}" != container ] || in_container
type ros2 >/dev/null 2>&1 || { echo "real_ros.sh: no ros2 here: source the setup of ROS" >&2; exit 2; }
for _ in $(seq 60); do
	ros2 node list --no-daemon --spin-time 2 2>/dev/null | grep -qx "$ROBOT/sidestep" && break
done

goal='{pose: {header: {frame_id: map}, pose: {position: {x: 6.4, y: 6.4}, orientation: {w: 1.0}}}}'
twist='{linear: {x: 0.2}}'
static="--qos-durability transient_local --qos-reliability reliable"
step 'node'             "^$ROBOT/sidestep$"           ros2 node list --no-daemon --spin-time 3
step 'topics'           'odom \[nav_msgs/msg/Odometry\]' ros2 topic list -t --no-daemon --spin-time 3
step 'type hashes'      'RIHS01_'                     ros2 topic info -v "$ROBOT/odom" --no-daemon --spin-time 3
step 'odom'             'child_frame_id: base_link'   ros2 topic echo --once "$ROBOT/odom"
step 'rate of odom'     'average rate: (19|20|21)'    timeout -s INT 10 ros2 topic hz "$ROBOT/odom"
step 'range'            'frame_id: sonar_3'           ros2 topic echo --once --qos-reliability best_effort "$ROBOT/sonar_3"
# shellcheck disable=SC2086
step 'URDF of a late joiner' '<robot name'            ros2 topic echo --once --full-length $static "$ROBOT/robot_description" std_msgs/msg/String
step 'transforms'       'Translation'                 timeout -s INT 8 ros2 run tf2_ros tf2_echo map base_link --ros-args -r "/tf:=$ROBOT/tf" -r "/tf_static:=$ROBOT/tf_static"
step 'parameters'       'v_max_m_s'                   ros2 param list "$ROBOT/sidestep"
step 'set a parameter'  'successful'                  ros2 param set "$ROBOT/sidestep" v_max_m_s 0.25
step 'its range'        'at most'                     ros2 param set "$ROBOT/sidestep" v_max_m_s 99.0
step 'arm'              'success=True'                ros2 service call "$ROBOT/arm" std_srvs/srv/Trigger
step 'lifecycle'        'active'                      ros2 service call "$ROBOT/bt_navigator/get_state" lifecycle_msgs/srv/GetState
step 'cmd_vel'          'publishing #20'              ros2 topic pub -r 10 -t 20 "$ROBOT/cmd_vel" geometry_msgs/msg/Twist "$twist"
bag=$(mktemp -d)/bag
timeout -s INT 60 ros2 bag record -s mcap -o "$bag" "$ROBOT/odom" "$ROBOT/tf" >/dev/null 2>&1 &
recorder=$!
echo '      the next step takes a minute: a goal across the forest'
drive=$(timeout 300 ros2 action send_goal --feedback "$ROBOT/navigate_to_pose" nav2_msgs/action/NavigateToPose "$goal" 2>&1)
step 'goal'             'status: SUCCEEDED'           echo "$drive"
step 'feedback'         'distance_remaining'          echo "$drive"
wait $recorder
step 'bag'              'Messages: +[1-9]'            ros2 bag info "$bag"
back='{pose: {header: {frame_id: map}, pose: {position: {x: 0.6, y: 0.6}, orientation: {w: 1.0}}}}'
step 'cancel by ctrl+c' '[Cc]ancel'                   timeout -s INT 5 ros2 action send_goal --feedback "$ROBOT/navigate_to_pose" nav2_msgs/action/NavigateToPose "$back"
step 'emergency stop'   'success=True'                ros2 service call "$ROBOT/emergency_stop" std_srvs/srv/Trigger
step 'it is latched'    'success=False'               ros2 service call "$ROBOT/arm" std_srvs/srv/Trigger
step 'clear'            'success=True'                ros2 service call "$ROBOT/clear" std_srvs/srv/Trigger
exit $failed
