"""clsim: live event-camera simulation from path-traced 3-D scenes."""

