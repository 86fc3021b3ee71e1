"""The car and the settings of a run: vehicle file, configuration, formula of the user."""
