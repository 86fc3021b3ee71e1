"""Write the results of a run, for people and for programs: tables, JSON, plots,
the HTML report."""
