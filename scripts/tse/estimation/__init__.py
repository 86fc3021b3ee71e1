"""Run the filter over a log, smooth its estimates, and describe them in words: the answer
in three lines, the verdicts, the events."""
