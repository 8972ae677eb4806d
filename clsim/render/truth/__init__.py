"""Truth of a view: depth, flow and identities, by rays through the middles of pixels."""
