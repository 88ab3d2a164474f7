"""The rig: the policy that stands above every back end, and the table of drivers."""
