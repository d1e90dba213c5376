"""MJCF, MuJoCo's format, read by GUARD itself onto the same neutral model as URDF; no MuJoCo is needed."""
