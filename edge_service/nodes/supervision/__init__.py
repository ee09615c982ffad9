"""Every task has an owner and a deadline: what ends or stalls is seen, told and begun again."""
