"""The one orchestration of a session: a request becomes a plan, the plan's steps are done, the result is told."""
