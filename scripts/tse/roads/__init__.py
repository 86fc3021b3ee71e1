"""Bank and grade along roads, and matching of the rows of a log with places on a road."""
