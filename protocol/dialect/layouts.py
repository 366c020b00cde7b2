"""Wire layouts of the messages.

Made by `make generate` from sidestep.xml: change that file instead.
"""

from typing import Final

# NAME id crc_extra field:[array length]struct-code ... in wire order
LAYOUTS: Final = """
HEARTBEAT 0 50 custom_mode:I type:B autopilot:B base_mode:B system_status:B mavlink_version:B
SYSTEM_TIME 2 137 time_unix_usec:Q time_boot_ms:I
PARAM_REQUEST_READ 20 214 param_index:h target_system:B target_component:B param_id:16s
PARAM_REQUEST_LIST 21 159 target_system:B target_component:B
PARAM_VALUE 22 220 param_value:f param_count:H param_index:H param_id:16s param_type:B
PARAM_SET 23 168 param_value:f target_system:B target_component:B param_id:16s param_type:B
MISSION_SET_CURRENT 41 28 seq:H target_system:B target_component:B
MISSION_CURRENT 42 28 seq:H total:H mission_state:B mission_mode:B
MISSION_REQUEST_LIST 43 132 target_system:B target_component:B mission_type:B
MISSION_COUNT 44 221 count:H target_system:B target_component:B mission_type:B
MISSION_CLEAR_ALL 45 232 target_system:B target_component:B mission_type:B
MISSION_ITEM_REACHED 46 11 seq:H
MISSION_ACK 47 153 target_system:B target_component:B type:B mission_type:B
MISSION_REQUEST_INT 51 196 seq:H target_system:B target_component:B mission_type:B
MANUAL_CONTROL 69 243 x:h y:h z:h r:h buttons:H target:B buttons2:H enabled_extensions:B s:h t:h
  aux1:h aux2:h aux3:h aux4:h aux5:h aux6:h
MISSION_ITEM_INT 73 38 param1:f param2:f param3:f param4:f x:i y:i z:f seq:H command:H
  target_system:B target_component:B frame:B current:B autocontinue:B mission_type:B
COMMAND_INT 75 158 param1:f param2:f param3:f param4:f x:i y:i z:f command:H target_system:B
  target_component:B frame:B current:B autocontinue:B
COMMAND_LONG 76 152 param1:f param2:f param3:f param4:f param5:f param6:f param7:f command:H
  target_system:B target_component:B confirmation:B
COMMAND_ACK 77 143 command:H result:B progress:B result_param2:i target_system:B
  target_component:B
TIMESYNC 111 34 tc1:q ts1:q
STATUSTEXT 253 83 severity:B text:50s id:H chunk_seq:B
SONAR_SCAN 54100 175 time_ns:Q seq:I range_mm:8H ping_age_us:8H valid:B echo:B
WHEEL_TICKS 54101 255 time_ns:Q seq:I left:i right:i bumper:B expired:B
WHEEL_COMMAND 54102 184 time_ns:Q seq:I sense_seq:I epoch:I left_mrad_s:i right_mrad_s:i
  ttl_ms:H
PLANAR_ODOMETRY 54103 173 time_ns:Q x_m:f y_m:f heading_rad:f speed_m_s:f yaw_rate_rad_s:f
  cov_xx_m2:f cov_xy_m2:f cov_xh_m_rad:f cov_yy_m2:f cov_yh_m_rad:f cov_hh_rad2:f
NAVIGATOR_STATUS 54104 117 time_ns:Q goal_started_ns:Q goal_ended_ns:Q goal_id:Q stop_id:Q
  goal_x_m:f goal_y_m:f goal_heading_rad:f goal_distance_m:f vehicle:B mode:B goal:B
  vehicle_reason:B goal_reason:B navigator:B side:b
AVOIDANCE_DECISION 54105 215 time_ns:Q nearest_bearing_rad:f nearest_range_m:f zone_m:f
  goal_bearing_rad:f rotation_rad:f virtual_x_m:f virtual_y_m:f speed_m_s:f yaw_rate_rad_s:f
  branch:B guard:B
CYCLE_REPORT 54106 206 time_ns:Q tick:I missed:I overruns:I rejected:I late_us:I sense_age_us:I
  budget_us:I stage_us:5H
GROUND_TRUTH 54107 178 time_ns:Q seq:I x_m:f y_m:f heading_rad:f speed_m_s:f yaw_rate_rad_s:f
  clearance_m:f contact:B
GOAL_REQUEST 54108 64 request_id:Q x_mm:i y_mm:i heading_urad:i heading_tolerance_urad:I
  position_tolerance_mm:H heading_free:B mode:B
COMMAND_REQUEST 54109 126 request_id:Q param1:f param2:f command:H
RUN_REQUEST 54110 38 until_ns:Q action:B
RUN_SCORE 54111 83 time_ns:Q x_m:d y_m:d heading_rad:d path_m:d min_clearance_m:d ticks:I
  contacts:I own_contacts:I digest:32B
LEASE_REQUEST 54112 226 request_id:Q action:B name:16s
LEASE_STATUS 54113 140 time_ns:Q lapses_ms:I held:B holder:56s name:16s
TELEOP 54114 95 time_ns:Q seq:I speed_mm_s:h yaw_rate_mrad_s:h ttl_ms:H
MISSION_STATUS 54115 240 time_ns:Q mission_id:I hold_left_ms:I count:H current:H state:B
  reason:B
MISSION_VERDICT 54116 40 mission_id:I item:H reason:B mission_type:B
TICK_INPUTS 54117 143 time_ns:Q now_ms:Q tick:I wheels_seq:I scan_seq:I requests:I scan_age_ms:I
  operator_age_ms:I speed_mm_s:h yaw_rate_mrad_s:h flags:B
"""
