"""Results for people and programs: tables, plots, the report in HTML."""
