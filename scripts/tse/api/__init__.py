"""Public functions and classes of tse, one module a workflow. `import tse` offers
them."""
