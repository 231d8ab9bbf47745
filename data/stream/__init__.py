"""How do samples arrive one by one? Lines of text, their time stamps, pipes and sockets."""
