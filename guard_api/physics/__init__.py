"""The contract between GUARD and a simulator: `Backend`, `World`, `State`, and the actuation law they share."""
