"""Public functions and classes of tse, with a module for each workflow. Use them as
tse.NAME after `import tse`."""
