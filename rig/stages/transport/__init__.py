"""Light transport learned from a few more photographs: step `transport`."""
