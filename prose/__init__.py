"""The prose check of `make lint`: words and phrases that the documentation and the messages do not use."""
