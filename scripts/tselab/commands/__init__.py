"""The commands that have options of their own: options in, modules of tse called, messages out."""
