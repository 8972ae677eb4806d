"""Events over sockets: addresses, senders and receivers."""
