"""`tselab fleet`: many logs of many cars. find.py says which, work.py estimates one, run.py all of them, keep.py keeps what is
done, page.py shows it."""
