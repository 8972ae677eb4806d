"""Motion from files, along splines, and by chance."""
