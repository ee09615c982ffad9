/* A Modbus TCP device by libmodbus: serves one client after the other until it is killed.
 * Holding registers 0-1: float 0.25, high word first; 2-3: float -1.5, low word first; 4: counter of requests;
 * input registers 0-1: int32 -100000, high word first. */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

int main(int argc, char **argv) {
    modbus_t *device = modbus_new_tcp("127.0.0.1", argc > 1 ? atoi(argv[1]) : 1502);
    modbus_mapping_t *map = modbus_mapping_new(0, 0, 130, 130);
    int listening = modbus_tcp_listen(device, 1);
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    if (listening < 0 || map == NULL) {
        return 1;
    }
    map->tab_registers[0] = 0x3E80; /* IEEE 754 by hand: the library's own float functions */
    map->tab_registers[3] = 0xBFC0; /* changed their byte order between versions */
    map->tab_input_registers[0] = 0xFFFE;
    map->tab_input_registers[1] = 0x7960;
    puts("listening");
    fflush(stdout);
    for (;;) {
        int length;
        if (modbus_tcp_accept(device, &listening) < 0) {
            return 1;
        }
        while ((length = modbus_receive(device, query)) >= 0) {
            map->tab_registers[4]++;
            modbus_reply(device, query, length, map);
        }
        modbus_close(device);
    }
}
