"""The rig on the bus without the rig: muscles, valves, joint and encoder, emulated."""
