// SIGINT and SIGTERM end the program in an orderly way: the work in progress notices and throws.
#pragma once

namespace farol {

void installSignalHandlers();
void throwIfInterrupted();  // throws Interrupted once a signal has arrived

}  // namespace farol
