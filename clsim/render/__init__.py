"""The Warp path tracer: World → Frame."""
