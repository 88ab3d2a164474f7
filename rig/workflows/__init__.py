"""What a session does: one file a step, each over an open rig and an open session; `verbs` for scripts."""
