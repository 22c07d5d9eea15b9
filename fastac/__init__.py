"""The front door: scenes, the command line, the build, the report."""
