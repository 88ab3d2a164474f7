"""The projectors of a plan: their numbers, what each of them meets, and all of them as one picture."""
