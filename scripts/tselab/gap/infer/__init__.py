"""Which effects the logs show: every set of them judged by its evidence, what no model explains among what is weighed."""
