"""Operations that read the state of a robot or a recording and change nothing."""
