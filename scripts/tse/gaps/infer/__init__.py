"""What is missing: sets of effects judged by their evidence, a formula where the
catalogue has none. Logs that were held out judge both.
"""
