"""The gap workflow: where simulation and measurement disagree, which physical effect is missing, and what adding it brings.

data -> problem (simulate) -> fit -> where, name, detect, remainder, show -> workflow
"""
