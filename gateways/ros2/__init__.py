"""Each robot as a ROS 2 node on a Zenoh network, as `rmw_zenoh` would put it there.

`wire` has the names and bytes of rmw_zenoh, `interfaces` the message types and their CDR, `node`
nodes with topics, services and actions on a Zenoh session, and `face` what a robot offers.
"""
