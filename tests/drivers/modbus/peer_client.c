/* A Modbus TCP master by libmodbus: reads two registers and prints them, ten times. */
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    modbus_t *master = modbus_new_tcp("127.0.0.1", argc > 1 ? atoi(argv[1]) : 1502);
    uint16_t words[2];
    int reads;
    modbus_set_slave(master, 1);
    if (modbus_connect(master) < 0) {
        return 1;
    }
    for (reads = 0; reads < 10; reads++) {
        if (modbus_read_registers(master, 0, 2, words) != 2) {
            return 2;
        }
        printf("%04x%04x\n", words[0], words[1]);
    }
    modbus_close(master);
    modbus_free(master);
    return 0;
}
