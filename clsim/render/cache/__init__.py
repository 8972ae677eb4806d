"""Light known on surfaces: the radiance cache, stored paths, and what they are updated by."""
