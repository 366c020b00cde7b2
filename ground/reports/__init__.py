"""Operations that look and change nothing: at a robot that is there, or at a recording."""
