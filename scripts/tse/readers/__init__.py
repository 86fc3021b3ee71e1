"""Read logs: readers.py chooses the module read_*.py that reads the format of a file."""
