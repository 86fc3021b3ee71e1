"""FMUs: building ours for all platforms, checking anybody's, and driving one with a table of inputs."""
