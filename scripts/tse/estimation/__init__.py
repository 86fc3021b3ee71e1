"""Run the filter over a log, and put its result into words: answer, verdict, events,
smoother."""
