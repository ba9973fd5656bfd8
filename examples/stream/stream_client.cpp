// A client of `mograft stream` in C++17 without libraries, for POSIX and Windows.
//
//   c++ -std=c++17 stream_client.cpp -o stream_client      (Windows: add ws2_32.lib)
//   stream_client PORT FRAMES OUTPUT
//
// FRAMES holds float32 numbers: for each frame the local rotations of all joints (x, y, z, w) and
// the translation of the root. The client sends one frame at a time, as an engine does, and writes
// the frames that it receives to OUTPUT: rotations, then translations, of all joints.
// docs/howto/stream.md describes the protocol. The machine must be little-endian.

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#ifdef _WIN32
#include <winsock2.h>
#include <ws2tcpip.h>
using Socket = SOCKET;
#else
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>
using Socket = int;
#endif

struct Reply {
    std::string header;        // JSON
    std::vector<float> body;   // the arrays, in the order of the header
};

// Returns the number after "NAME": in a JSON header; an engine would use its JSON parser.
static long number(const std::string& header, const std::string& name) {
    const std::string key = "\"" + name + "\": ";
    const size_t at = header.find(key);
    if (at == std::string::npos) throw std::runtime_error("no " + name + " in " + header);
    return std::strtol(header.c_str() + at + key.size(), nullptr, 10);
}

class Client {
public:
    explicit Client(int port) {
#ifdef _WIN32
        WSADATA data;
        WSAStartup(MAKEWORD(2, 2), &data);
#endif
        socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(static_cast<uint16_t>(port));
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
            throw std::runtime_error("no server at this port");
        const int on = 1;
        ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, reinterpret_cast<const char*>(&on),
                     sizeof on);
    }

    ~Client() {
#ifdef _WIN32
        ::closesocket(socket_);
#else
        ::close(socket_);
#endif
    }

    Reply request(const std::string& header, const std::vector<float>& body = {}) {
        const uint32_t lengths[2] = {static_cast<uint32_t>(header.size()),
                                     static_cast<uint32_t>(body.size() * sizeof(float))};
        std::string message("MGS1");
        message.append(reinterpret_cast<const char*>(lengths), sizeof lengths);
        message += header;
        message.append(reinterpret_cast<const char*>(body.data()), lengths[1]);
        send(message);
        return receive();
    }

private:
    void send(const std::string& data) {
        for (size_t sent = 0; sent < data.size();) {
            const auto n = ::send(socket_, data.data() + sent, data.size() - sent, 0);
            if (n <= 0) throw std::runtime_error("the server has closed the connection");
            sent += static_cast<size_t>(n);
        }
    }

    void read(void* target, size_t size) {
        for (size_t got = 0; got < size;) {
            const auto n = ::recv(socket_, static_cast<char*>(target) + got, size - got, 0);
            if (n <= 0) throw std::runtime_error("the server has closed the connection");
            got += static_cast<size_t>(n);
        }
    }

    Reply receive() {
        char magic[4];
        uint32_t lengths[2];
        read(magic, sizeof magic);
        if (std::memcmp(magic, "MGS1", 4) != 0) throw std::runtime_error("not mograft.stream/1");
        read(lengths, sizeof lengths);
        Reply reply{std::string(lengths[0], '\0'), std::vector<float>(lengths[1] / sizeof(float))};
        read(reply.header.data(), lengths[0]);
        read(reply.body.data(), lengths[1]);
        if (reply.header.find("\"type\": \"error\"") != std::string::npos)
            throw std::runtime_error(reply.header);
        return reply;
    }

    Socket socket_;
};

static std::string push_header(long joints) {
    const std::string n = std::to_string(joints);
    return "{\"type\": \"push\", \"arrays\": ["
           "{\"name\": \"rotations\", \"dtype\": \"float32\", \"shape\": [1, " + n + ", 4]}, "
           "{\"name\": \"positions\", \"dtype\": \"float32\", \"shape\": [1, 3]}]}";
}

int main(int argc, char** argv) {
    if (argc != 4) {
        std::fprintf(stderr, "usage: stream_client PORT FRAMES OUTPUT\n");
        return 2;
    }
    try {
        Client client(std::atoi(argv[1]));
        const Reply welcome = client.request(
            "{\"type\": \"hello\", \"protocol\": \"mograft.stream/1\", \"seed\": 7, \"horizon\": 4}");
        const long joints = number(welcome.header, "n_joints");

        std::ifstream frames(argv[2], std::ios::binary);
        std::ofstream output(argv[3], std::ios::binary);
        std::vector<float> frame(static_cast<size_t>(joints) * 4 + 3);
        const auto size = static_cast<std::streamsize>(frame.size() * sizeof(float));
        long received = 0;
        const auto play = [&](const Reply& pieces) {
            const long n = number(pieces.header, "n_frames");  // 0 for most replies
            const float* rotations = pieces.body.data();
            const float* positions = rotations + n * joints * 4;
            for (long i = 0; i < n; ++i) {
                output.write(reinterpret_cast<const char*>(rotations + i * joints * 4),
                             joints * 4 * static_cast<long>(sizeof(float)));
                output.write(reinterpret_cast<const char*>(positions + i * joints * 3),
                             joints * 3 * static_cast<long>(sizeof(float)));
            }
            received += n;
        };
        while (frames.read(reinterpret_cast<char*>(frame.data()), size))
            play(client.request(push_header(joints), frame));
        play(client.request("{\"type\": \"close\"}"));
        std::printf("%ld frames\n", received);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
