"""What a world and a robot in it are made of: frozen values in SI units."""
