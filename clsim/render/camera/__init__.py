"""The camera: rays through pixels, and the film that their samples fall on."""
